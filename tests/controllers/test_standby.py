"""STANDBY: the walk to a pose, second by second."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import JOINTS, tick

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.standby import StandbyController
from humanoid_sim.errors import FieldError
from humanoid_sim.testing import clock_jumps

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


def run(controller, times, position=START):
    """The command and the report at each of the times; the first is the activation."""
    memory = controller.activate(tick(times[0], position=position))
    assert not isinstance(memory, Fault)
    results = []
    for time in times:
        memory, command = controller.update(memory, tick(time, position=position))
        results.append((command, memory.standby))
    return results


def at(seconds, **changes):
    """What a fine-grained walk has reached after so many seconds."""
    return run(standby(**changes), [5.0 + 0.02 * i for i in range(round(seconds / 0.02) + 1)])[-1]


@pytest.mark.parametrize(
    ("seconds", "position", "ramp", "segment", "progress"),
    [
        (0.0, [1.0, -1.0, 0.5], 0.0, 0, 0.0),
        (0.5, [0.75, -0.75, 0.375], 0.25, 0, 0.25),
        (1.0, [0.5, -0.5, 0.25], 0.5, 0, 0.5),
        (1.9, [0.05, -0.05, 0.025], 0.95, 0, 0.95),
        (2.2, [0.08, -0.16, 0.24], 1.0, 1, 0.2),
        (2.5, [0.2, -0.4, 0.6], 1.0, 1, 0.5),
        (2.9, [0.36, -0.72, 1.08], 1.0, 1, 0.9),
    ],
)
def test_values_on_the_way(seconds, position, ramp, segment, progress):
    command, report = at(seconds)
    np.testing.assert_allclose(command.position, position, atol=1e-12)
    np.testing.assert_allclose(command.stiffness, np.array([10.0, 20.0, 30.0]) * ramp, atol=1e-11)
    np.testing.assert_allclose(command.damping, np.array([1.0, 2.0, 3.0]) * ramp, atol=1e-12)
    assert command.velocity.tolist() == command.effort.tolist() == [0.0, 0.0, 0.0]
    assert (report.current_segment, report.total_segments, report.is_finished) == (segment, 2, False)
    assert report.progress == pytest.approx(progress, abs=1e-12)


@pytest.mark.parametrize("seconds", [3.02, 3.5, 60.0])
def test_finished_is_exactly_the_pose_and_the_gains(seconds):
    command, report = at(seconds)
    assert command.position.tolist() == [0.4, -0.8, 1.2]
    assert command.stiffness.tolist() == [10.0, 20.0, 30.0]
    assert command.damping.tolist() == [1.0, 2.0, 3.0]
    assert (report.current_segment, report.total_segments, report.progress, report.is_finished) == (1, 2, 1.0, True)


@pytest.mark.parametrize("start", [START, (3.0, 3.0, -3.0), (0.0, 0.0, 0.0)])
def test_torque_starts_at_zero_from_anywhere(start):
    command, _ = run(standby(), [7.0], position=start)[0]
    assert command.position.tolist() == list(start)
    assert command.stiffness.tolist() == command.damping.tolist() == [0.0, 0.0, 0.0]


def test_one_segment_many_and_gains_that_are_one_number():
    command, report = at(1.0, segment_durations=[2.0], pose_segments=[[0.0, 0.0, 0.0]])
    assert command.stiffness == pytest.approx([5.0, 10.0, 15.0]), "gains reach their targets in segment 0"
    assert (report.current_segment, report.total_segments) == (0, 1)
    poses = [[0.0] * 3, [1.0] * 3, [0.0] * 3, [-1.0] * 3]
    command, report = at(3.5, segment_durations=[1.0] * 4, pose_segments=poses)
    np.testing.assert_allclose(command.position, [-0.5] * 3, atol=1e-12)
    assert report.current_segment == 3
    command, _ = at(4.0, target_stiffness=50, target_damping=2.0)
    assert (command.stiffness.tolist(), command.damping.tolist()) == ([50.0] * 3, [2.0] * 3)


def test_a_stall_of_the_host_does_not_make_the_arms_jump():
    (_, before), (after, report) = run(standby(), [0.0, 100.0])
    assert before.progress == 0.0
    assert report.progress == pytest.approx(0.025)  # max_time_step 0.05 of 2 s
    np.testing.assert_allclose(after.position, [0.975, -0.975, 0.4875])
    for time, progress in ((100.0, 0.25), (0.3, 0.15)):
        _, (_, report) = run(standby(max_time_step=0.5), [0.0, time])
        assert report.progress == pytest.approx(progress)


@given(st.lists(clock_jumps(), max_size=60), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_any_clock(jumps, first, second):
    """Progress never falls, no tick covers more than `max_time_step`, and every value stays within its ends."""
    controller = standby(segment_durations=[first, second])
    time = 0.0
    memory = controller.activate(tick(time, position=START))
    place = 0.0
    low, high = np.minimum(START, [0.0, -0.8, 0.0]), np.maximum(START, [0.4, 0.0, 1.2])
    for jump in jumps:
        time = time + jump if np.isfinite(time + jump) else 0.0
        memory, command = controller.update(memory, tick(time, position=START))
        report = memory.standby
        assert 0.0 <= report.progress <= 1.0
        before, place = (
            place,
            report.progress * first if report.current_segment == 0 else first + report.progress * second,
        )
        assert before - 1e-9 <= place <= before + 0.05 + 1e-9
        assert (command.position >= low - 1e-12).all()
        assert (command.position <= high + 1e-12).all()
        assert (command.stiffness <= [10.0, 20.0, 30.0]).all()
        assert command.is_finite()


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        *(
            (tick(0.02, position=(0.0, value, 0.0)), f"position of elbow is {value}, expected a finite number")
            for value in (NAN, INF, -INF)
        ),
        *((tick(value), f"time is {value}, expected a finite number") for value in (NAN, INF, -INF)),
        (tick(0.02, position=(0.0,) * 4), "state has (4,) joint positions, expected (3,)"),
    ],
)
def test_time_and_every_joint_must_be_known(bad, message):
    controller = standby()
    memory = controller.activate(tick(0.0, position=START))
    for fault in (controller.activate(bad), controller.update(memory, bad)):
        assert isinstance(fault, Fault)
        assert fault.message == message


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"target_stiffness": [1.0, 2.0]}, r"target_stiffness: has shape \(2,\), expected \(3,\)"),
        ({"target_stiffness": [1.0, -2.0, 3.0]}, "target_stiffness: is -2.0 for elbow, expected a finite number >= 0"),
        ({"target_damping": [1.0, 2.0, INF]}, "target_damping: is inf for wrist"),
        ({"target_damping": -1}, "target_damping: is -1.0 for shoulder"),
        ({"segment_durations": []}, r"segment_durations: has shape \(0,\), expected one or more durations"),
        ({"segment_durations": 2.0}, r"segment_durations: has shape \(\), expected one or more durations"),
        ({"segment_durations": [2.0, 0.0]}, r"segment_durations\[1\]: is 0.0, expected a finite number > 0"),
        ({"segment_durations": [-1.0, 1.0]}, r"segment_durations\[0\]: is -1.0, expected a finite number > 0"),
        ({"segment_durations": [2.0, NAN]}, r"segment_durations\[1\]: is nan"),
        ({"segment_durations": [2.0]}, "pose_segments: has 2 poses, expected 1, one per segment duration"),
        ({"pose_segments": []}, "pose_segments: has 0 poses, expected 2"),
        ({"pose_segments": [[0.0] * 3]}, "pose_segments: has 1 poses, expected 2"),
        ({"pose_segments": [[0.0] * 3, [0.0] * 2]}, r"pose_segments\[1\]: has shape \(2,\), expected \(3,\)"),
        ({"pose_segments": [[0.0] * 3, 0.0]}, r"pose_segments\[1\]: has shape \(1,\), expected \(3,\)"),
        ({"pose_segments": [[0.0] * 3, [0.0, NAN, 0.0]]}, r"pose_segments\[1\]: is nan for elbow"),
        ({"pose_segments": [[0.0, 0.0, "x"], [0.0] * 3]}, r"pose_segments\[0\]: dtype is <U"),
        ({"pose_segments": [[[0.0] * 3], [[0.0] * 3]]}, r"pose_segments\[0\]: has shape \(1, 3\)"),
        ({"pose_segments": [[[0.0], [0.0] * 2], [0.0] * 3]}, r"pose_segments\[0\]: not a rectangular array"),
        ({"pose_segments": 0.0}, r"pose_segments\[0\]: has shape \(1,\)"),
        ({"pose_segments": None}, r"pose_segments\[0\]: dtype is object"),
        ({"max_time_step": 0.0}, "max_time_step: is 0.0, expected a finite number > 0"),
    ],
)
def test_invalid_parameters_are_named(parameters, message):
    with pytest.raises(FieldError, match=rf"^StandbyController\.{message}"):
        standby(**parameters)
