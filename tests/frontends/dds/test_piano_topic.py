"""A key that a simulated finger presses, as a client that knows nothing of this project hears of it."""

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

from fates import playing
from play_fixtures import quick_robot
from pressing import KEY, press_in_standby
from stranger import client
from waiting import until

from humanoid_sim.messages import Mode


@pytest.mark.soak
def test_pressed_keys_are_on_dds(folder):
    robot = quick_robot(folder, "lite_piano", change=press_in_standby)
    fast = ("--pace", "realtime", "--actuation", "affine")
    script = "hold 0.3; damp; hold 0.1; load_a; wait; hold 20; damp; hold 0.1"
    options = ("--robot", robot, "--policy", "placeholder", "--script", script, "--dds", *fast)
    with playing(folder, *options) as play, client(play.domain) as stranger:
        reader = stranger.reader("rt/piano/key_state")
        until(lambda: any([i for i in range(88) if sample.data[i]] == [KEY] for sample in reader.take(10)))
        assert play.mode() is Mode.STANDBY
        play.operator.ask("damp")
        play.operator.ask("quit")
        log = play.finish()
    assert log.status == 0, play.said
