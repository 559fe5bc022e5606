"""A MIDI keyboard that is lost in each mode on emulated motors, by a policy that hears it."""

import pytest
from fates import playing, script, skip_unless
from lost_keyboard import LOSSES, check_loss, down, piano_options, play_and_lose, plugged_in
from play_fixtures import quick_robot

from humanoid_sim.messages import Mode

pytestmark = pytest.mark.soak

PERIOD = 0.02
"""s"""
TOO_LATE = 0.035
"""s between two ticks: such a run says nothing."""
ATTEMPTS = 4


def lost(folder, mode, loss):
    """A run on a machine that was in time, which was in that mode when the keyboard was lost."""
    hardware = (
        "--hardware",
        f"virtual:{folder.name}",
        "--yes",
        "--allow-script",
        "--robot",
        quick_robot(folder, "lite_piano"),
    )
    options = (*piano_options(folder, "lite_piano"), *hardware, "--script", script(mode))
    for _ in range(ATTEMPTS):
        with plugged_in(folder) as keyboard, playing(folder, *options) as play:
            play_and_lose(play, keyboard, mode, loss)
            log = play.finish()
        if log.longest_pause() <= TOO_LATE and log.mode_at(log.blow) is mode:
            assert log.status == int(mode is Mode.LOCOMOTION), play.said
            return log
    pytest.fail("the machine is too busy: ticks were late, or the mode was over before the loss", pytrace=False)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
def test_a_keyboard_that_is_lost_damps_the_policy_that_hears_it_and_changes_nothing_else(
    mode, loss, folder, rows, request
):
    skip_unless((mode, loss) == (Mode.LOCOMOTION, "killed"), request)
    log = lost(folder, mode, loss)
    if mode is Mode.LOCOMOTION:
        what = f"DAMPING {1e3 * check_loss(log, loss, PERIOD):.0f} ms after the last sample"
    else:
        assert not any(tick.output.faults for tick in log.ticks)
        assert down(log, -1) == ([] if loss == "unplugged" else [39, 43])
        what = f"{14 * len(log.ticks)} frames, none missing"
    hardware = log.summary["hardware"]
    assert hardware["commanded"] == hardware["acknowledged"] >= 14 * len(log.ticks)
    assert (hardware["invalid_frames"], hardware["refused"], log.summary["safety"]) == (0, 0, [])
    assert log.is_exact()
    rows.append(("midi", loss, mode.name, "motors", what))
