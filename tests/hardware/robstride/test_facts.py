"""Frames that misled people who drove these motors, and what they mean. Each was reported with a real motor."""

import struct

import pytest

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.robstride import protocol
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, unpack_value
from humanoid_sim.hardware.robstride.protocol import FrameType, decode_reply, encode_command
from humanoid_sim.robots.motors import MOTORS

HOST = 0xFD
MODELS = {0x02: MOTORS["rs-02"], 0x05: MOTORS["rs-05"], 0x0A: MOTORS["rs-03"], 0x15: MOTORS["rs-02"]}


def received(identifier, data, **flags):
    return decode_reply(Frame(identifier, data, **flags), MODELS, HOST)


def test_a_reply_in_11_bit_framing_is_no_status():
    """A motor in the MIT protocol answers with its own id; LeRobot's reads 29 bits out of 11."""
    found = received(0x005, bytes.fromhex("7fff7ff0000007ff"), is_extended=False)
    assert found == protocol.Ignored("standard_id")


def test_the_echo_of_a_failed_read_is_never_a_value():
    """0x110115FD: bit 16 says that the read failed; its four zero bytes are no position 0.0."""
    failed = received(0x110115FD, struct.pack("<Hxxf", PARAMETERS["mechPos"].index, 0.0))
    assert isinstance(failed, protocol.ParameterReply)
    assert not failed.is_success
    good = received(0x110015FD, struct.pack("<Hxxf", PARAMETERS["mechPos"].index, 1.25))
    assert isinstance(good, protocol.ParameterReply)
    assert good.is_success
    assert unpack_value(PARAMETERS["mechPos"].type, good.payload) == 1.25


def test_the_velocity_is_not_the_current():
    assert {name: PARAMETERS[name].index for name in ("mechPos", "iqf", "mechVel", "VBUS")} == {
        "mechPos": 0x7019,
        "iqf": 0x701A,
        "mechVel": 0x701B,
        "VBUS": 0x701C,
    }


def test_full_scale_of_an_rs_05_is_5_5_newton_metres_and_50_radians_a_second():
    status = received(0x028005FD, struct.pack(">HHHH", 32767, 65534, 65534, 305))
    assert isinstance(status, protocol.Status)
    assert (status.effort, status.velocity, status.temperature) == pytest.approx((5.5, 50.0, 30.5))


@pytest.mark.parametrize("data", ["00c456000203092904", "00c4560002030904"], ids=["English manual", "Chinese manual"])
def test_a_version_reply_is_no_motor_of_1050_degrees(data):
    """Both come as a frame of type 2; a byte differs between the manuals."""
    reply = received(0x020002FD, bytes.fromhex(data)[:8])
    assert isinstance(reply, protocol.Version)


def test_an_identifier_of_the_vendors_usb_adapter_is_shifted_by_three_bits():
    """In its AT frames 0x2007E854 is 0x0400FD0A: a stop of motor 10; as it stands it would ask motor 0x54."""
    frame = Frame(0x2007E854 >> 3, bytes(8))
    assert frame.arbitration_id == 0x0400FD0A
    assert encode_command(FrameType.STOP, 0x0A) == frame
    assert received(0x100057EC >> 3, bytes.fromhex("a6d4808c7fff0140")).motor_id == 0x0A
