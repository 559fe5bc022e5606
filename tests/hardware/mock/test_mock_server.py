"""Mock motors in real time on python-can channels."""

import errno
import time

import can
import numpy as np
import pytest
from mock_rig import IDS, LITE, MODELS
from waiting import until

from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.messages import Enable


def _send(bus, command):
    frame = encode_command(command, MODELS[command.motor_id])
    bus.send(can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=True))


def _answers(bus, count, patience=20.0):
    """Up to `count` frames of motors."""
    found = []
    deadline = time.monotonic() + patience
    while len(found) < count and time.monotonic() < deadline:
        message = bus.recv(0.05)
        if message is not None and message.arbitration_id & 0xFF in (0xFD, 0xFE):
            found.append(message)
    return found


@pytest.fixture
def log():
    return []


@pytest.fixture
def motors(log):
    with MockServer(LITE, ["virtual:mock"], log=lambda _, text: log.append(text)) as motors:
        yield motors


@pytest.fixture
def bus(motors):
    with motors.open_bus(motors.addresses[0]) as bus:
        yield bus


def test_motors_answer_and_their_frames_are_stamped_with_their_arrival(motors, bus):
    sent = time.time()
    for motor_id in IDS:
        _send(bus, Enable(motor_id))
    answers = _answers(bus, len(IDS))
    assert sorted(message.arbitration_id >> 8 & 0xFF for message in answers) == sorted(IDS)
    assert all(message.arbitration_id >> 22 & 3 == 2 for message in answers)
    stamps = [message.timestamp for message in answers]
    assert sent < stamps[0]
    assert stamps == sorted(stamps)
    bus.send(can.Message(arbitration_id=np.int64(0x0300FD0E), data=bytes(8), is_extended_id=True))
    assert len(_answers(bus, 1)) == 1, "to a message with NumPy's integers"


def test_the_computers_end_of_a_channel_fails_as_socketcan_does(motors, bus, log):
    motors.inject(Fault("tx_full"))
    until(lambda: log)
    with pytest.raises(can.CanOperationError) as refused:
        _send(bus, Enable(14))
    assert refused.value.error_code == errno.ENOBUFS
    motors.clear_faults()
    motors.inject(Fault("bus_off"))
    message = bus.recv(20.0)
    assert (message.is_error_frame, message.arbitration_id) == (True, 0x40)
    with pytest.raises(can.CanOperationError) as refused:
        _send(bus, Enable(14))
    assert refused.value.error_code == errno.ENETDOWN


def test_the_shared_clock_waits_for_motors_that_are_late(motors):
    ahead = []

    def hold_up(mock):
        time.sleep(0.1)
        ahead.append(motors.clock() - mock.time)

    motors.call(hold_up)
    assert ahead[0] == pytest.approx(0.05), "s, and no more"
    until(lambda: motors.stood_still > 0.03)
