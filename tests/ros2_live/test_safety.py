"""A fault that a ROS 2 node of default settings publishes on `/safety_status`: the robot is damped."""

import pytest
from machines import play, read_until
from strangers import ticks

pytestmark = pytest.mark.ros

DAMPING, STANDBY = 1, 2


def tell(fence, line):
    fence.stdin.write(f"{line}\n")
    fence.stdin.flush()
    read_until(fence, "published")


def test_a_fault_damps_and_its_end_moves_nothing(robot, messages):
    session = play(robot, "--dds", script="damp; load_a; wait; hold 300")
    try:
        read_until(session, "DAMPING → STANDBY")
        fence = robot.ros("fence.py", environment=messages)
        read_until(fence, "ready")
        tell(fence, "0 closed")
        assert {tick["mode"] for tick in ticks(robot, 0.5)} == {STANDBY}
        tell(fence, "2 the gate is open")
        read_until(session, "STANDBY → DAMPING")
        tell(fence, "0 closed")
        after = ticks(robot, 0.5)
        assert after
        assert {tick["mode"] for tick in after} == {DAMPING}, "nothing recovers by itself"
        assert all(set(tick["stiffness"]) == {0.0} and min(tick["damping"]) > 0.0 for tick in after)
    finally:
        session.terminate()
        session.wait(30.0)
