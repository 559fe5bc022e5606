"""Trajectories of a ROS 2 action client with default settings, by `examples/ros2/follow_joint_trajectory.py`."""

import json
import sys

import pytest
from machines import ROOT, ROS_PYTHON, play, read_until
from strangers import is_passive, ticks

pytestmark = pytest.mark.ros

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
ELBOWS = ("left_elbow_pitch", "right_elbow_pitch")
ASK = """
import sys, time
from humanoid_sim.client import Intake, find_session
with Intake(find_session(), "test") as intake:
    while not (answer := intake.ask(sys.argv[1])).granted:
        print(answer.text)
        time.sleep(0.5)
"""


class Planner:
    """A ROS 2 action client that stays."""

    def __init__(self, machine, messages):
        for _ in range(8):  # of two default nodes in a namespace one in three never finds the other
            self._program = machine.ros("follow.py", environment=messages)
            if "ready" in self._program.stdout.readline():
                return
        raise AssertionError("no action server was found")

    def send(self, *points, path=None, goal=None, goal_time=0.0):
        """Send a goal."""
        self.say(json.dumps([points, path or {}, goal or {}, goal_time]))

    def say(self, line):
        self._program.stdin.write(line + "\n")
        self._program.stdin.flush()

    def result(self):
        """Status, error code, text, and how much feedback there was."""
        return tuple(json.loads(read_until(self._program, "[")[-1]))

    def follow(self, *points, and_then="", **tolerances):
        """The result of a goal; it is sent again where a busy machine has made the server stand still."""
        text = "stood still"
        while "stood still" in text:
            self.send(*points, **tolerances)
            if and_then:
                self.say(and_then)
            status, code, text, shown = self.result()
        return status, code, text, shown


def ask(machine, word):
    machine.run(sys.executable, "-c", ASK, word, cwd=ROOT)


def elbows(machine):
    """Where they are held, rad: half a second in which they are driven, as a busy machine has some."""
    passive = [True]
    while any(passive):
        fed = ticks(machine, 0.5)
        passive = [is_passive(tick) for tick in fed] or [True]
        assert not all(passive)
    first, last = ([tick["joint_position"][place] for place in (3, 10)] for tick in (fed[0], fed[-1]))
    assert first == pytest.approx(last, abs=0.02)
    return last


def test_a_trajectory_moves_the_arms_and_every_way_to_end_it(robot, messages):
    server = robot.start(
        str(ROS_PYTHON),
        str(ROOT / "examples" / "ros2" / "follow_joint_trajectory.py"),
        environment={**messages, "PYTHONPATH": f"{ROOT}:{messages['PYTHONPATH']}"},
        cwd=ROOT,
    )
    read_until(server, "action /remote_policy_controller/follow_joint_trajectory on this machine")
    planner = Planner(robot, messages)
    there, back = (dict.fromkeys(ELBOWS, where) for where in (-0.9, -0.5))
    assert planner.follow((1.0, there)) == (ABORTED, -1, "no session is running; start one with play", 0)
    session = play(robot, script="damp; load_a; wait; hold 300")
    try:
        read_until(session, "DAMPING → STANDBY")
        status, code, text, _ = planner.follow((1.0, there))
        assert (status, code) == (ABORTED, -1)
        assert text.startswith("only REMOTE follows trajectories, the mode is STANDBY")
        ask(robot, "start_remote")

        status, code, text, shown = planner.follow((1.0, back), (2.0, there), goal=dict.fromkeys(ELBOWS, 0.05))
        assert (status, code) == (SUCCEEDED, 0), text
        assert shown > 0
        error = max(abs(where + 0.9) for where in elbows(robot))
        print(f"{text}; {error:.4f} rad at rest")
        assert text.startswith("largest error 0.")
        assert error < 0.05

        status, _, text, _ = planner.follow((20.0, back), and_then="cancel")
        assert (status, text) == (CANCELED, "cancelled; the joints are held where they were commanded")
        assert max(elbows(robot)) < -0.6, "it went no further"

        status, code, text, _ = planner.follow((0.2, back), path=dict.fromkeys(ELBOWS, 0.01))
        assert (status, code) == (ABORTED, -4)
        assert "_elbow_pitch was 0." in text
        assert "on its way, tolerated are 0.01 rad" in text
        status, code, text, _ = planner.follow((0.5, there), goal={"left_elbow_pitch": 1e-6}, goal_time=0.2)
        assert (status, code) == (ABORTED, -5)
        assert text.startswith("left_elbow_pitch was ")
        elbows(robot)

        planner.send((20.0, back))
        planner.send((20.0, there))
        assert planner.result()[:3] == (ABORTED, -1, "another goal has taken its place")
        ask(robot, "damp")
        status, code, text, _ = planner.result()
        assert (status, code) == (ABORTED, -1)
        assert text == "only REMOTE follows trajectories, the mode is DAMPING: DAMP requested"
    finally:
        session.terminate()
        session.wait(30.0)
        server.terminate()
        assert server.wait(30.0) == 0
