"""CAN channels: addresses, locks, threads that never stop for a driver, and frames that come or leave late."""

import errno
import queue
import threading
import time

import can
import pytest
from waiting import until

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.can_bus import (
    NEVER,
    BusAddress,
    Channel,
    Frame,
    message_of,
    open_bus,
    parse_address,
    parse_addresses,
)

FRAME = Frame(0x1234567, b"12345678")


# --- addresses


@pytest.mark.parametrize(
    ("text", "interface", "channel"),
    [
        ("can0", "socketcan", "can0"),
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
        ("", "expected a network interface"),
        ("../can0", "expected a network interface"),
        ("socketkan:can0", "unknown interface 'socketkan' .did you mean 'socketcan'"),
        ("can0,can0", "'can0,can0': a channel is named twice"),
    ],
)
def test_what_cannot_be_an_address_is_refused(text, says):
    with pytest.raises(InputError, match=says) as caught:
        parse_addresses(text)
    assert f"'{text}'" in str(caught.value)


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (OSError(errno.ENODEV, "No such device"), "no such network interface: see `ip link`"),
        (OSError(errno.ENETDOWN, "Network is down"), "sudo ip link set can0 up type can bitrate 1000000"),
        (OSError(errno.EAFNOSUPPORT, "Address family"), "modprobe can_raw"),
        (OSError(errno.EACCES, "Permission denied"), "-aG dialout"),
        (OSError("pcanbasic library not found."), "found.: pip install 'python-can.socketcan.'"),
        (can.CanInterfaceNotImplementedError("No module named 'usb'"), "'usb': pip install 'python-can.socketcan.'"),
    ],
)
def test_a_channel_that_cannot_be_opened_says_what_to_do(monkeypatch, error, says):
    def fail(**_):
        raise error

    monkeypatch.setattr(can, "Bus", fail)
    with pytest.raises(RobotError, match=f"^can0: cannot be opened: .*{says}"):
        open_bus(BusAddress("socketcan", "can0"))


# --- one channel


class ScriptedBus(can.BusABC):
    """Receives what is put into `incoming`; `on_send` is given what is sent, and may raise."""

    def __init__(self):
        super().__init__(channel="scripted")
        self.incoming, self.received = queue.SimpleQueue(), []
        self.on_send = lambda _: None

    def _recv_internal(self, timeout):
        try:
            return self.incoming.get(timeout=timeout), False
        except queue.Empty:
            return None, False

    def send(self, msg, timeout=None):
        self.on_send(msg)


@pytest.fixture
def bus():
    return ScriptedBus()


@pytest.fixture
def channel(bus):
    address = BusAddress("virtual", "scripted")
    channel = Channel(address, lambda _, when: bus.received.append(when), open_bus=lambda _: bus)
    yield channel
    channel.close()


def test_a_frame_is_as_old_as_its_stamp(bus, channel):
    for age in (0.3, 3600.0, -5.0):  # it lay in the kernel; the process was stopped for an hour; the clock was set
        bus.incoming.put(message_of(FRAME, time.time() - age))
    assert until(lambda: len(bus.received) == 3)
    now = time.monotonic()
    ages = [now - when for when in bus.received]
    assert 0.3 <= ages[0] < 20.0
    assert ages[1] > 5.0
    assert 0.0 <= ages[2] < 20.0


@pytest.mark.parametrize(
    "error", [can.CanOperationError("Transmit buffer full"), can.CanTimeoutError(), OSError(errno.EAGAIN, "try again")]
)
def test_every_way_to_say_full_is_understood(error, bus, channel):
    pending = [error]

    def full(_):
        if pending:
            raise pending.pop()

    bus.on_send = full
    channel.send([("left", FRAME)])
    assert until(lambda: channel.sent == 1)
    assert channel.down == ""


def test_sending_never_waits_for_the_driver(bus, channel):
    stuck, returned = threading.Event(), []
    bus.on_send = lambda _: returned.append(stuck.wait(60.0))
    for number in range(20):
        channel.send([(joint, Frame(number, bytes(8))) for joint in range(14)])
        time.sleep(0.005)
    assert returned == [], "the driver's first call has not come back"
    assert channel.tx_full is not NEVER
    stuck.set()


def test_a_multicast_group_has_neither_its_own_frames_nor_another_groups():
    groups = [BusAddress("udp_multicast", f"239.74.163.{number}") for number in (201, 202)]
    with open_bus(groups[0]) as bus, open_bus(groups[0]) as peer, open_bus(groups[1]) as stranger:
        stranger.send(message_of(Frame(7, b"another")))
        bus.send(message_of(FRAME))
        assert peer.recv(10.0).arbitration_id == FRAME.arbitration_id
        peer.send(message_of(FRAME))  # the same frame once more: this one is another host's
        assert bus.recv(10.0).arbitration_id == FRAME.arbitration_id
        assert bus.recv(0.0) is None
