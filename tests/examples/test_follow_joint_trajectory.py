"""What trajectories are read and judged, without ROS 2; with it they are followed in `tests/ros2_live`."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from script_files import load_script

from humanoid_sim.client import Feed
from humanoid_sim.messages import Intent

EXAMPLE = Path(__file__).parents[2] / "examples" / "ros2" / "follow_joint_trajectory.py"
NAMES = ("shoulder", "elbow", "wrist")
START = np.array([0.4, 0.5, 0.6])


@pytest.fixture(scope="module")
def example():
    return load_script(EXAMPLE)


@pytest.fixture
def robot(example, monkeypatch):
    ones = np.ones(3)
    found = example.Robot(NAMES, -2.0 * ones, 2.0 * ones, 5.0 * ones, 40.0 * ones, 4.0 * ones)
    monkeypatch.setattr(example, "robot_of", lambda _: found)
    return found


def seconds(value):
    return SimpleNamespace(sec=int(value // 1), nanosec=round(1e9 * (value % 1)))


def trajectory(*points, names=("elbow", "wrist")):
    """Of points: time, positions, velocities, effort."""
    rows = [(*point, [], [])[:4] for point in points]
    return SimpleNamespace(
        joint_names=names,
        points=[
            SimpleNamespace(time_from_start=seconds(t), positions=p, velocities=v, effort=e) for t, p, v, e in rows
        ],
    )


def goal(message, elbow=0.0):
    """With a tolerance for the elbow on its way, rad."""
    path = SimpleNamespace(name="elbow", position=elbow, velocity=0.0, acceleration=0.0)
    nothing = {"multi_dof_trajectory": SimpleNamespace(points=[]), "goal_tolerance": []}
    return SimpleNamespace(trajectory=message, path_tolerance=[path], goal_time_tolerance=seconds(0.0), **nothing)


def test_lines_are_straight_without_velocities_and_smooth_with_them(example, robot):
    read = example.read_trajectory(
        trajectory((1.0, [1.5, 0.6], [], [3.0, 0.0]), (3.0, [0.5, 0.6], [], [0.0, 0.0])), robot, START
    )
    for when, wanted in (
        (-1.0, (0.5, 0.0, 0.0)),
        (0.5, (1.0, 1.0, 1.5)),
        (2.0, (1.0, -0.5, 1.5)),
        (9.0, (0.5, 0.0, 0.0)),
    ):
        assert [column[1] for column in read.at(when)] == pytest.approx(wanted)
        assert read.at(when)[0][[0, 2]].tolist() == [0.4, 0.6], "others stay"
    begun = example.read_trajectory(trajectory((0.0, [0.45, 0.6]), (1.0, [1.5, 0.6])), robot, START)
    assert begun.at(0.5)[0][1] == pytest.approx(1.0), "from where the joint is, not with a jump"
    read = example.read_trajectory(
        trajectory((1.0, [1.0, 0.6], [0.8, 0.0]), (2.0, [1.5, 0.6], [0.0, 0.0])), robot, START
    )
    assert read.at(1.0)[1][1] == pytest.approx(0.8)
    for when in (0.3, 0.999, 1.001, 1.7):
        slope = (read.at(when + 1e-5)[0] - read.at(when - 1e-5)[0]) / 2e-5
        assert read.at(when)[1] == pytest.approx(slope, abs=1e-4)


@pytest.mark.parametrize(
    ("message", "code", "text"),
    [
        (trajectory((1.0, [1.0]), names=("knee",)), -2, "joint_names: unknown joint 'knee'; the robot has: "),
        (trajectory((1.0, [1.0, 1.0]), (1.0, [1.0, 1.0])), -1, "time_from_start: is 1, 1 s, expected to increase"),
        (trajectory((1.0, [1.0, np.nan])), -1, "positions: expected 2 numbers in each point"),
        (trajectory((0.0, [0.7, 0.6]), (1.0, [1.0, 0.6])), -1, "elbow begins 0.200 rad away"),
        (trajectory((1.0, [0.5, -2.5])), -1, "wrist goes to -2.500 rad, beyond its limit"),
        (trajectory((0.1, [1.5, 0.6])), -1, "elbow moves at 10.000 rad/s, faster than it can"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_robot_is_refused_with_the_reason(example, robot, message, code, text):
    with pytest.raises(example.GoalError) as caught:
        example.read_trajectory(message, robot, START)
    assert caught.value.code == code
    assert str(caught.value).startswith(text)


@pytest.mark.usefixtures("robot")
def test_remote_is_left_to_its_owner_and_joints_are_held_however_a_goal_ends(example, local, monkeypatch):
    monkeypatch.setattr(example.Stay, "_run", lambda _: None)  # its ticks are counted here
    other = local.intake("other")
    local.enter_remote()
    for _ in range(30):
        other.remote(NAMES, *[[0.1] * 3] * 5)
        local.tick()
    with pytest.raises(example.GoalError, match=rf"^REMOTE belongs to other \({os.getpid()}\)$"):
        example.Stay(local.info)
    for _ in range(30):
        local.tick()
    stay = example.Stay(local.info)
    local.stack.callback(stay.close)
    feed = local.stack.enter_context(Feed(local.info))

    def tick():
        """Step; the command that is then in force."""
        problem = stay.step(feed.decode(feed.latest()))
        return problem or local.tick().output.command.position.tolist()

    followed = stay.begin(goal(trajectory((0.2, [0.6, 0.6])), 0.05))
    commands = [tick() for _ in range(7)]  # of a robot that does not move
    assert commands[1] == pytest.approx([0.4, 0.51, 0.6])
    assert followed.ended.is_set()
    assert (followed.code, followed.text) == (-4, "elbow was 0.060 rad off 0.12 s on its way, tolerated are 0.05 rad")
    assert [tick(), tick()][-1] == [0.4, 0.5, 0.6], "it is held where it is"
    cancelled = stay.begin(goal(trajectory((0.4, [0.9, 0.6]))))
    commands = [tick() for _ in range(4)]
    stay.cancel(cancelled)
    assert [tick(), tick()][-1] == commands[-1] == pytest.approx([0.4, 0.56, 0.6]), "it is held where it is commanded"
    late = stay.begin(goal(trajectory((0.4, [0.9, 0.6]))))
    local.time += 0.5
    local.tick()
    assert [tick(), tick()][-1] == [0.4, 0.5, 0.6]
    assert (late.code, late.text[:43]) == (-1, "this program stood still for 0.54 s, and RE")
    local.tick(Intent.DAMP)
    assert tick() == "only REMOTE follows trajectories, the mode is DAMPING: DAMP requested"
