"""Addresses, and opening them."""

import errno
import random

import can
import pytest

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.bus import address
from humanoid_sim.hardware.bus.address import (
    BusAddress,
    bus_hints,
    error_number,
    open_bus,
    parse_address,
    parse_addresses,
)


@pytest.mark.parametrize(
    ("text", "interface", "channel"),
    [
        ("can0", "socketcan", "can0"),
        (" can1 ", "socketcan", "can1"),
        ("virtual:lite", "virtual", "lite"),
        ("udp_multicast:239.74.163.2", "udp_multicast", "239.74.163.2"),
        ("udp_multicast:ff15::6d:63", "udp_multicast", "ff15::6d:63"),
        ("slcan:/dev/ttyACM0@115200", "slcan", "/dev/ttyACM0@115200"),
    ],
)
def test_an_address_names_interface_and_channel(text, interface, channel):
    address = parse_address(text)
    assert (address.interface, address.channel) == (interface, channel)
    assert parse_address(str(address)) == address


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "names no channel"),
        ("virtual:", "names no channel"),
        (":can0", "names no interface"),
        ("socketkan:can0", "unknown interface 'socketkan' .did you mean 'socketcan'..; known: .*socketcan"),
        ("socketcan:", "names no channel"),
        ("a-very-long-interface", "cannot be a network interface's name"),
        ("can 0", "cannot be a network interface's name"),
        ("../can0", "cannot be a network interface's name"),
    ],
)
def test_what_cannot_be_an_address_is_one_line(text, says):
    with pytest.raises(InputError, match=says) as caught:
        parse_address(text)
    assert "\n" not in str(caught.value)
    assert f"'{text}'" in str(caught.value)


def test_a_list_keeps_the_order_of_the_buses():
    assert [str(address) for address in parse_addresses("can1,can0")] == ["can1", "can0"]
    assert parse_addresses("virtual:a") == (BusAddress("virtual", "a"),)


def test_a_channel_named_twice_is_refused():
    with pytest.raises(InputError, match="can0 is named twice"):
        parse_addresses("can0,can0")


CAN0 = BusAddress("socketcan", "can0")


def _network(folder, name, kind, queue="10"):
    (folder / name).mkdir()
    (folder / name / "type").write_text(f"{kind}\n")
    (folder / name / "tx_queue_len").write_text(f"{queue}\n")


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (errno.EAFNOSUPPORT, "can0: cannot be opened: this kernel has no SocketCAN"),
        (errno.ENODEV, "there is no such network interface; CAN interfaces of this machine: can1, can2"),
        (errno.ENETDOWN, "it is down: sudo ip link set can0 up type can bitrate 1000000"),
        (errno.EPERM, "this user may not open raw CAN sockets"),
        (errno.EIO, "OSError: "),
    ],
)
def test_a_socketcan_interface_that_cannot_be_opened_says_why(number, says, monkeypatch, tmp_path):
    for name, kind in (("can2", "280"), ("can1", "280"), ("eth0", "1")):
        _network(tmp_path, name, kind)
    monkeypatch.setattr(address, "_NETWORK", tmp_path)

    def fail(**_):
        raise OSError(number, "whatever the kernel says")

    monkeypatch.setattr(can, "Bus", fail)
    with pytest.raises(RobotError, match=says) as caught:
        open_bus(CAN0)
    assert "\n" not in str(caught.value)


def test_an_adapter_that_is_not_there_is_one_line():
    with pytest.raises(RobotError, match=r"slcan:/dev/no-such-adapter: cannot be opened: \w+") as caught:
        open_bus(BusAddress("slcan", "/dev/no-such-adapter"))
    assert "\n" not in str(caught.value)


def test_the_bit_rate_is_given_where_the_interface_needs_it(monkeypatch):
    options = []
    monkeypatch.setattr(can, "Bus", lambda **given: options.append(given))
    for interface in ("pcan", "socketcan"):
        open_bus(BusAddress(interface, "x"))
    assert options == [
        {"interface": "pcan", "channel": "x", "bitrate": 1_000_000},
        {"interface": "socketcan", "channel": "x"},
    ]


def test_a_kernel_queue_shorter_than_two_bursts_is_mentioned(monkeypatch, tmp_path):
    _network(tmp_path, "can0", "280", "10")
    monkeypatch.setattr(address, "_NETWORK", tmp_path)
    assert bus_hints(CAN0, 14) == (
        "its outgoing queue takes 10 frames, a control period sends 14: sudo ip link set can0 txqueuelen 100",
    )
    assert bus_hints(CAN0, 5) == ()
    assert bus_hints(BusAddress("socketcan", "can9"), 14) == ()
    assert bus_hints(BusAddress("virtual", "can0"), 14) == ()


def test_the_error_number_is_found_wherever_python_can_put_it():
    assert error_number(can.CanOperationError("full", error_code=errno.ENOBUFS)) == errno.ENOBUFS
    assert error_number(OSError(errno.ENETDOWN, "down")) == errno.ENETDOWN
    wrapped = can.CanOperationError("failed to send")
    wrapped.__cause__ = OSError(errno.ENETUNREACH, "unreachable")
    assert error_number(wrapped) == errno.ENETUNREACH
    assert error_number(can.CanOperationError("Transmit buffer full")) is None


def test_two_multicast_groups_do_not_hear_each_other(monkeypatch):
    """The port is python-can's own for all: only the group tells two buses of one machine apart."""
    real, later = can.Bus, []

    def opened_late(**options):
        """A frame of the other group comes before anything can be asked of the socket."""
        bus = real(**options)
        sender.send(can.Message(arbitration_id=0x1234))
        assert near.recv(2.0) is not None
        return bus

    groups = [BusAddress("udp_multicast", f"239.74.{random.randrange(256)}.{last}") for last in (81, 82)]
    try:
        ends = [open_bus(group) for group in (groups[0], groups[0], groups[1])]
    except RobotError as error:
        pytest.skip(f"no multicast here: {error}")
    sender, near, far = ends
    try:
        sender.send(can.Message(arbitration_id=0x1234, data=b"hello"))
    except can.CanOperationError as error:
        pytest.skip(f"no multicast here: {error}")
    else:
        heard = near.recv(2.0)
        assert bytes(heard.data) == b"hello"
        assert far.recv(0.05) is None
        monkeypatch.setattr(can, "Bus", opened_late)
        later.append(open_bus(groups[1]))
        assert later[0].recv(0.05) is None
    finally:
        for end in (*ends, *later):
            end.shutdown()
