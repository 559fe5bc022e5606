"""Emulated motors in real time on python-can channels."""

import errno
import time

import can
import numpy as np
import pytest
from bus_rig import IDS, LITE, MODELS_BY_ID

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robstride.codec import encode_command
from humanoid_sim.hardware.robstride.messages import Enable, OperationControl
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


def _wait_for_failure(motors):
    deadline = time.monotonic() + 2.0
    while motors.failure is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert motors.failure is not None


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


def test_time_goes_on_by_itself_and_the_truth_is_fresh(motors, bus):
    _send(bus, Enable(14))
    _send(bus, OperationControl(14, 0.0, 0.0, 2.0, 0.0, 0.0))
    _answers(bus, 2)
    before = motors.truth
    time.sleep(0.2)
    after = motors.truth
    assert after.time - before.time == pytest.approx(0.2, abs=0.1)
    assert abs(time.monotonic() - after.time) < 0.1
    elbow = LITE.joint_names.index(ELBOW)
    assert after.joint_position[elbow] < before.joint_position[elbow] - 0.02, "its motor's direction is -1"
    assert after.joint_effort[elbow] == pytest.approx(-2.0, abs=1e-3)
    np.testing.assert_allclose(after.imu.linear_acceleration, [0.0, 0.0, 9.81], atol=0.02)


def test_a_fault_now_and_a_hand(motors, bus):
    motors.inject(Fault("silent", (ELBOW,)))
    time.sleep(0.01)
    _send(bus, Enable(14))
    assert _answers(bus, 1, patience=0.1) == []
    motors.move_by_hand({ELBOW: -1.0})
    time.sleep(0.4)
    assert motors.truth.joint_position[LITE.joint_names.index(ELBOW)] == pytest.approx(-1.0, abs=0.2)
    with pytest.raises(InputError, match="unknown joint 'tail'"):
        motors.move_by_hand({"tail": 1.0})
    with pytest.raises(RobotError, match="fixed base"):
        motors.set_support(True)


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


def test_two_channels_are_the_robots_two_buses():
    with VirtualMotors(LITE, ["virtual:left", "virtual:right"]) as motors:
        buses = [motors.open_bus(address) for address in motors.addresses]
        try:
            for bus in buses:
                for motor_id in IDS:
                    _send(bus, Enable(motor_id))
            heard = [sorted(m.arbitration_id >> 8 & 0xFF for m in _answers(bus, 7)) for bus in buses]
            assert heard == [IDS[:7], IDS[7:]]
        finally:
            for bus in buses:
                bus.shutdown()


def test_on_an_interface_where_a_sender_hears_itself_nothing_is_counted_twice():
    with VirtualMotors(LITE, ["udp_multicast:239.74.163.61"]) as motors, motors.open_bus(motors.addresses[0]) as bus:
        _send(bus, Enable(14))
        assert len(_answers(bus, 1)) == 1
        time.sleep(0.05)
        assert motors.frames() == 2


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


def test_what_breaks_the_emulation_is_said_and_raised_at_the_end():
    motors = VirtualMotors(LITE, ["virtual:broken"])

    def break_it(emulator):
        emulator.advance = None

    motors.call(break_it)
    _wait_for_failure(motors)
    assert isinstance(motors.failure, TypeError)
    with pytest.raises(TypeError):
        motors.close()
    motors.close()


def test_motors_that_cannot_keep_up_stand_still_for_a_while_instead_of_answering_ever_later(motors, bus):
    motors.call(lambda _: time.sleep(0.3))
    _send(bus, Enable(14))
    sent = time.time()
    (answer,) = _answers(bus, 1)
    assert motors.slipped == pytest.approx(0.3, abs=0.1)
    assert answer.timestamp - sent < 0.1
    began = motors.time
    time.sleep(0.1)
    assert 0.05 < motors.time - began < 0.3, "and time goes on"


def test_a_channel_that_fails_ends_the_emulation_with_one_line():
    motors = VirtualMotors(LITE, ["virtual:unplugged"])
    can_bus = motors._buses[0]
    motors.call(lambda _: can_bus.shutdown())
    _wait_for_failure(motors)
    with pytest.raises(RobotError, match="Virtual bus channel unplugged: receiving fails: "):
        motors.close()


def test_wrong_channels_are_refused_and_leave_nothing_open():
    with pytest.raises(InputError, match="lite: no channel is named"):
        VirtualMotors(LITE, [])
    with pytest.raises(InputError, match="unknown interface 'morse'"):
        VirtualMotors(LITE, ["morse:x"])
    with pytest.raises(RobotError):
        VirtualMotors(LITE, ["virtual:one", "can77"])
