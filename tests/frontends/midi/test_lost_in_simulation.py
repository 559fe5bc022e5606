"""A MIDI keyboard that is lost in each mode of a simulated run, by a policy that hears it."""

import pytest
from fates import ROWS, playing, script, skip_unless
from lost_keyboard import LOSSES, check_loss, down, piano_options, play_and_lose, plugged_in
from play_fixtures import quick_robot

from humanoid_sim.messages import Mode

pytestmark = pytest.mark.soak

PERIOD = 0.005
"""s"""
ATTEMPTS = 4


def lost(folder, mode, loss):
    """A run that was in that mode when the keyboard was lost."""
    options = (*piano_options(folder), "--robot", quick_robot(folder), "--script", script(mode), "--pace", "realtime")
    for _ in range(ATTEMPTS):
        with plugged_in(folder) as keyboard, playing(folder, *options) as play:
            play_and_lose(play, keyboard, mode, loss)
            log = play.finish()
        if log.mode_at(log.blow) is mode:
            assert log.status == int(mode is Mode.LOCOMOTION), play.said  # a policy that is stopped is a failure
            if loss == "unplugged":
                assert "midi: ./keys is gone: all keys released" in play.said
            return log
    pytest.fail("the machine is too busy: the mode was over before the keyboard was lost", pytrace=False)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
def test_a_keyboard_that_is_lost_stops_the_policy_that_hears_it_and_changes_nothing_else(
    mode, loss, folder, rows, request
):
    skip_unless((mode, loss) == (Mode.LOCOMOTION, "unplugged"), request)
    assert ROWS["midi"].feeds
    log = lost(folder, mode, loss)
    if mode is Mode.LOCOMOTION:
        took = check_loss(log, loss, PERIOD)
        what = f"DAMPING {1e3 * took:.0f} ms after the last sample"
    else:
        assert not any(tick.output.faults for tick in log.ticks)
        assert down(log, -1) == ([] if loss == "unplugged" else [39, 43])
        what = f"{len(log.ticks)} ticks, none other"
    assert log.is_exact()
    rows.append(("midi", loss, mode.name, "simulated", what))
