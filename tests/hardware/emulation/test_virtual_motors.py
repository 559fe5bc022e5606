"""Emulated motors in real time on python-can channels."""

import errno
import time

import can
import numpy as np
import pytest
from bus_rig import IDS, LITE, MODELS_BY_ID

from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.messages import Enable
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.sensors import live_inputs

pytestmark = pytest.mark.soak

ELBOW = "left_elbow_pitch"


def _send(bus, command):
    frame = encode_command(command, MODELS_BY_ID[command.motor_id])
    bus.send(can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=True))


def _answers(bus, count, patience=2.0):
    """Up to `count` frames of motors."""
    found = []
    deadline = time.monotonic() + patience
    while len(found) < count and time.monotonic() < deadline:
        message = bus.recv(0.05)
        if message is not None and message.arbitration_id & 0xFF in (0xFD, 0xFE):
            found.append(message)
    return found


@pytest.fixture
def motors():
    with VirtualMotors(LITE, ["virtual:emulated"]) as motors:
        yield motors


@pytest.fixture
def bus(motors):
    with motors.open_bus(motors.addresses[0]) as bus:
        yield bus


def test_motors_answer_and_their_frames_are_stamped_with_the_time_of_their_arrival(motors, bus):
    sent = time.time()
    for motor_id in IDS:
        _send(bus, Enable(motor_id))
    answers = _answers(bus, len(IDS))
    assert sorted(message.arbitration_id >> 8 & 0xFF for message in answers) == sorted(IDS)
    assert all(message.arbitration_id >> 22 & 3 == 2 for message in answers)
    stamps = [message.timestamp for message in answers]
    assert sent < stamps[0]
    assert stamps == sorted(stamps)
    assert motors.frames() == 2 * len(IDS)
    bus.send(can.Message(arbitration_id=np.int64(0x0300FD0E), data=bytes(8), is_extended_id=True))
    assert len(_answers(bus, 1)) == 1, "to a message with NumPy's integers"
    assert motors.failure is None


def test_the_computers_end_of_a_channel_fails_as_socketcan_does(motors, bus):
    motors.inject(Fault("enobufs", duration=0.1))
    time.sleep(0.02)
    with pytest.raises(can.CanOperationError) as caught:
        _send(bus, Enable(14))
    assert caught.value.error_code == errno.ENOBUFS
    time.sleep(0.12)
    _send(bus, Enable(14))
    assert len(_answers(bus, 1)) == 1

    motors.inject(Fault("bus_off"))
    message = bus.recv(1.0)
    assert message.is_error_frame
    assert message.arbitration_id == 0x40
    with pytest.raises(can.CanOperationError) as caught:
        _send(bus, Enable(14))
    assert caught.value.error_code == errno.ENETDOWN


def test_a_floating_base_is_held_and_let_go():
    biped = load_robot("lite_biped")
    with VirtualMotors(biped, ["virtual:biped"]) as motors:
        assert motors.supported
        height = motors.truth.qpos[2]
        motors.set_support(False)
        time.sleep(0.3)
        assert not motors.supported
        assert motors.truth.qpos[2] < height - 0.02, "without torque its knees give way"
        assert set(motors.truth.live) == set(live_inputs(build_model(biped), biped, ""))
