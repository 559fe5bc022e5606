"""STANDBY: the trajectory to a pose, second by second."""

import numpy as np
import pytest
from rig import JOINTS, tick

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.standby import StandbyController

NAN, INF = np.nan, np.inf
START = (1.0, -1.0, 0.5)
PARAMETERS = {
    "target_stiffness": [10.0, 20.0, 30.0],
    "target_damping": [1.0, 2.0, 3.0],
    "segment_durations": [2.0, 1.0],
    "pose_segments": [[0.0, 0.0, 0.0], [0.4, -0.8, 1.2]],
}


def standby(**changes):
    return StandbyController(JOINTS, **{**PARAMETERS, **changes})


def run(controller, times):
    """Command and report at each of the times; the first is the activation."""
    memory = controller.activate(tick(times[0], position=START))
    results = []
    for time in times:
        memory, command = controller.update(memory, tick(time, position=START))
        results.append((command, memory.standby))
    return results


def at(seconds, **changes):
    """Command and report after so many seconds at 50 Hz."""
    return run(standby(**changes), [5.0 + 0.02 * i for i in range(round(seconds / 0.02) + 1)])[-1]


@pytest.mark.parametrize(
    ("seconds", "position", "ramp", "segment", "progress"),
    [
        (0.0, [1.0, -1.0, 0.5], 0.0, 0, 0.0),
        (0.5, [0.75, -0.75, 0.375], 0.25, 0, 0.25),
        (2.2, [0.08, -0.16, 0.24], 1.0, 1, 0.2),
        (3.02, [0.4, -0.8, 1.2], 1.0, 1, 1.0),
        (60.0, [0.4, -0.8, 1.2], 1.0, 1, 1.0),
    ],
)
def test_values_on_the_way_and_at_the_end(seconds, position, ramp, segment, progress):
    command, report = at(seconds)
    is_finished = progress == 1.0
    np.testing.assert_allclose(command.position, position, atol=1e-12)
    np.testing.assert_allclose(command.stiffness, np.array([10.0, 20.0, 30.0]) * ramp, atol=1e-11)
    np.testing.assert_allclose(command.damping, np.array([1.0, 2.0, 3.0]) * ramp, atol=1e-12)
    assert command.velocity.tolist() == command.effort.tolist() == [0.0, 0.0, 0.0]
    assert (report.current_segment, report.total_segments, report.is_finished) == (segment, 2, is_finished)
    assert report.progress == pytest.approx(progress, abs=1e-12)


def test_a_stall_of_the_host_does_not_make_the_arms_jump():
    _, (after, report) = run(standby(), [0.0, 100.0])
    assert report.progress == pytest.approx(0.025)  # 0.05 s of 2 s
    np.testing.assert_allclose(after.position, [0.975, -0.975, 0.4875])


@pytest.mark.parametrize(
    ("bad", "part"),
    [
        *((tick(0.02, position=(0.0, value, 0.0)), f"elbow is {value}") for value in (NAN, INF)),
        *((tick(value), f"time is {value}") for value in (NAN, -INF)),
    ],
)
def test_time_and_every_joint_must_be_known(bad, part):
    controller = standby()
    memory = controller.activate(tick(0.0, position=START))
    for fault in (controller.activate(bad), controller.update(memory, bad)):
        assert isinstance(fault, Fault)
        assert part in fault.message
