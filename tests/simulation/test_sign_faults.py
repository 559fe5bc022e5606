"""The table of `tools.studies.sign_faults`: no sound robot is accused, no fewer faults are found than before."""

import pytest

from tools.studies.sign_faults import robots, study

FOUND = {
    "lite": (8, 8),
    "lite_sito": (8, 8),
    "lite_biped": (4, 8),
    "g1_holosoma": (13, 19),
    "g1_unitree": (9, 17),
    "berkeley_biped": (2, 2),
    "berkeley_humanoid": (8, 8),
}
"""Mirrored joints for which START is refused, in STANDBY's pose and with check poses."""


@pytest.mark.slow
@pytest.mark.parametrize("name", FOUND)
def test_nobody_is_accused_and_faults_are_found(name, request):
    variations = 40 if request.config.getoption("--complete") else 4
    chosen = dict(robots([name]))
    if not chosen:
        pytest.skip("no published policies here")
    for checks, least in zip((False, True), FOUND[name], strict=True):
        if checks and not chosen[name].check_poses:
            continue
        row = study(chosen[name], variations, checks=checks)
        assert row.accused == 0
        assert row.flips >= least
