"""Mock motors in real time on python-can channels."""

import time

import can
import pytest
from waiting import until

from humanoid_sim.hardware.can_bus import open_bus
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robstride.protocol import FrameType, encode_command
from humanoid_sim.robots.description import load_robot

IDS = [*range(11, 18), *range(21, 28)]


@pytest.fixture
def motors():
    with MockServer(load_robot("lite"), ["virtual:mock"]) as motors:
        yield motors


def test_motors_answer_and_their_frames_are_stamped_with_their_arrival(motors):
    sent = time.time()
    with open_bus(motors.addresses[0]) as bus:
        for motor_id in IDS:
            frame = encode_command(FrameType.ENABLE, motor_id)
            bus.send(can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=True))
        found = [bus.recv(20.0) for _ in IDS]
    assert sorted(message.arbitration_id >> 8 & 0xFF for message in found) == sorted(IDS)
    assert all(message.arbitration_id >> 22 & 3 == 2 for message in found)
    stamps = [message.timestamp for message in found]
    assert sent < stamps[0]
    assert stamps == sorted(stamps)


def test_the_shared_clock_waits_for_motors_that_are_late(motors):
    ahead = []

    def hold_up(mock):
        time.sleep(0.1)
        ahead.append(motors.clock() - mock.time)

    motors.call(hold_up)
    assert ahead[0] == pytest.approx(0.05), "s, and no more"
    until(lambda: motors.stood_still > 0.03)
