import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.adapter.control import CommandEncoder
from humanoid_sim.hardware.adapter.joint_tracking import JointTracker
from humanoid_sim.hardware.adapter.wiring import make_wiring
from humanoid_sim.hardware.motors import Readings
from humanoid_sim.hardware.robstride.codec import decode_command
from humanoid_sim.hardware.robstride.messages import OperationControl
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS


def _command(position, velocity=0.0, effort=0.0, stiffness=50.0, damping=2.0):
    n = np.atleast_1d(position).shape[0]
    return MITCommand(*(np.broadcast_to(value, n) for value in (position, velocity, effort, stiffness, damping)))


def _encoder(description):
    wiring = make_wiring(description, 2, {"left": 0.5, "right": 0.0})
    tracker = JointTracker(wiring, np.array([0.0, 1.0]))
    return CommandEncoder(wiring, 2, 0.04), tracker


def test_commands_leave_in_the_motors_frame_and_on_their_channels(description):
    encoder, tracker = _encoder(description)
    joints = tracker.update(Readings(np.zeros(2), np.array([0.5, -6.2]), np.zeros(2), np.zeros(2), np.zeros(2)))
    first, second = encoder.encode(
        _command([0.1, 0.2], [1.0, 2.0], [3.0, 4.0], [20.0, 10.0], [1.0, 1.0]), joints, tracker
    )
    (((joint, _), frame),) = first
    assert joint == 0
    decoded = decode_command(frame, 11, MOTORS["rs-02"])
    assert isinstance(decoded, OperationControl)
    assert decoded.position == pytest.approx(0.4, abs=4e-4)
    assert decoded.velocity == pytest.approx(-1.0, abs=2e-3)
    assert decoded.effort == pytest.approx(-3.0, abs=1e-3)
    assert decoded.stiffness == pytest.approx(20.0, abs=1e-2)
    assert decoded.damping == pytest.approx(1.0, abs=1e-4)
    (((joint, _), frame),) = second
    assert joint == 1
    decoded = decode_command(frame, 21, MOTORS["rs-00"])
    assert isinstance(decoded, OperationControl)
    assert decoded.position == pytest.approx(0.2 - 2.0 * np.pi, abs=4e-4), "a turn up at power-on"
    assert decoded.velocity == pytest.approx(2.0, abs=2e-3)
    assert encoder.saturations == {}
    assert encoder.bounded == {}


LITE = make_wiring(load_robot("lite"), 2, dict.fromkeys(load_robot("lite").joint_names, 0.0))
_any = st.floats(allow_nan=False, allow_infinity=False)


@given(st.lists(_any, min_size=70, max_size=70))
def test_every_finite_command_can_be_sent(values):
    """Whatever a controller asks for becomes frames of the motors, cut off where it must be."""
    command = MITCommand(*np.array(values).reshape(5, 14))
    tracker = JointTracker(LITE, np.zeros(14))
    joints = tracker.update(Readings(*(np.zeros(14) for _ in range(5))))
    batches = CommandEncoder(LITE, 2, 0.04).encode(command, joints, tracker)
    assert [joint for batch in batches for (joint, _), _ in batch] == list(range(14))
    for batch in batches:
        for (joint, _), frame in batch:
            decoded = decode_command(frame, LITE.motor_id[joint], LITE.model[joint])
            assert isinstance(decoded, OperationControl)
            assert abs(decoded.effort) <= LITE.effort_limit[joint] * 1.001
