"""A simulated piano's keys on their way: from a finger that presses one to the feed, the recording and the replay."""

from pressing import KEY, press_in_standby
from rosbags.highlevel import AnyReader

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.messages import Mode


def test_a_key_that_a_finger_presses_is_told_everywhere(run, make_robot, folder):
    robot = make_robot("lite_piano", change=press_in_standby)
    fast = ("--html", "none")
    result = run("--robot", robot, "--policy", "placeholder", "--script", "damp; load_a; wait; hold 0.3", *fast)
    assert result.status == 0, result.err
    assert all(tick.input.state.extern["key_pressed"].value.shape == (88,) for tick in result.ticks)
    down = [tick.input.state.extern["key_pressed"].value.nonzero()[0].tolist() for tick in result.ticks]
    assert down[0] == []
    standing = [tick.index for tick in result.ticks if tick.output.control_mode.mode is Mode.STANDBY]
    assert down[standing[-1]] == [KEY]
    with AnyReader([folder / "r.mcap"]) as reader:
        connections = [one for one in reader.connections if one.topic == "/piano/key_state"]
        shown = [reader.deserialize(data, one.msgtype) for one, _, data in reader.messages(connections)]
    told = [message.data.nonzero()[0].tolist() for message in shown]
    assert told[-1] == down[-1]
    assert [KEY] in told
    assert 0.9 < len(shown) / (0.25 * len(result.ticks)) < 1.5, "50 a second, of 200 ticks, and once for each change"
    assert run_program(replay.main, ["r.mcap"]) == 0
