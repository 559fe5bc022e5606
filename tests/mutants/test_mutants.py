"""Every reader of files from outside: mutants are read or refused with one line, in bounded time and memory."""

import pytest
from campaign import run_campaign, table
from targets import TARGETS

SEED = 20
SAMPLE, COMPLETE = 60, 3000
"""Mutants of each reader, times its weight."""


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_no_mutant_raises_hangs_prints_or_leaves_anything(request, tmp_path):
    wanted = COMPLETE if request.config.getoption("--complete") else SAMPLE
    counts = run_campaign(tmp_path, SEED, {name: round(wanted * target.weight) for name, target in TARGETS.items()})
    print(table(counts))
    assert not any(count.found for count in counts.values()), table(counts)
    for name, target in TARGETS.items():
        assert counts[name].mutants == round(wanted * target.weight) > 0
        assert counts[name].refused > 0, name
    assert sum(count.accepted for count in counts.values()) > len(TARGETS)


def test_a_campaign_finds_what_it_looks_for(tmp_path):
    """A reader that raises, hangs, prints, dies or leaves something is found: here, with readers that do so."""
    counts = run_campaign(tmp_path, SEED, dict.fromkeys(PLANTED, 1), "planted", cpu_limit=0.5)
    for what, text in PLANTED.items():
        assert len(counts[what].found) == 1, f"{what}: {counts[what]}"
        assert text in counts[what].found[0]


PLANTED = {
    "traceback": "ZeroDivisionError",
    "hang": "the process hangs",
    "print": "printed 'a banner",
    "death": "the process died",
    "file": "left ['MUJOCO_LOG.TXT']",
    "memory": "MemoryError",
    "no line": "no single line",
}
