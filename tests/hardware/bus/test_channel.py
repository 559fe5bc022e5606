import errno
import threading
import time

import can
import pytest
from scripted_bus import ScriptedBus
from waiting import wait_until

from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.channel import NEVER, Channel
from humanoid_sim.hardware.bus.frame import Frame

FRAME = Frame(0x1234567, b"12345678")


class Heard:
    def __init__(self):
        self.frames = []

    def __call__(self, frame, when):
        self.frames.append((frame, when))


@pytest.fixture
def heard():
    return Heard()


@pytest.fixture
def channel(address, heard):
    channel = Channel(address, heard)
    yield channel
    channel.close()


@pytest.fixture
def bus():
    return ScriptedBus()


@pytest.fixture
def scripted(bus, heard, address):
    channel = Channel(address, heard, open_bus=lambda _: bus)
    yield channel
    channel.close()


def _message(identifier=FRAME.arbitration_id, data=FRAME.data, **fields):
    return can.Message(arbitration_id=identifier, data=data, timestamp=time.time(), **fields)


def test_frames_go_both_ways(channel, heard, peer):
    peer.send(_message())
    assert wait_until(lambda: bool(heard.frames))
    assert heard.frames[0][0] == FRAME
    channel.send([("left", Frame(0x1FE, b"\1\2"))])
    message = peer.recv(1.0)
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (0x1FE, b"\1\2", True)
    assert (channel.counters.sent, channel.counters.received) == (1, 1)
    assert channel.down == ""


def test_a_frame_is_as_old_as_its_stamp(heard, bus, scripted):
    late = _message()
    late.timestamp -= 0.3  # it lay in the kernel while this process did not run
    suspended = _message()
    suspended.timestamp -= 3600.0  # the process was stopped for an hour
    unstamped = _message()
    unstamped.timestamp = 0.0
    future = _message()
    future.timestamp += 5.0
    for message in (late, suspended, unstamped, future):
        bus.incoming.put(message)
    assert wait_until(lambda: len(heard.frames) == 4)
    now = time.monotonic()
    ages = [now - when for _, when in heard.frames]
    assert 0.3 <= ages[0] < 2.0
    assert ages[1] > 5.0
    assert 0.0 <= ages[2] < 0.3
    assert 0.0 <= ages[3] < 0.3


@pytest.mark.parametrize(
    "error", [can.CanOperationError("Transmit buffer full"), can.CanTimeoutError(), OSError(errno.EAGAIN, "try again")]
)
def test_every_way_to_say_full_is_understood(error, bus, scripted):
    pending = [error]

    def full(_):
        if pending:
            raise pending.pop()

    bus.on_send = full
    scripted.send([("left", FRAME)])
    assert wait_until(lambda: scripted.counters.sent == 1)
    assert scripted.tx_full is NEVER


def test_sending_never_waits_for_the_driver(bus, address, heard):
    stuck, returned = threading.Event(), []
    bus.on_send = lambda _: returned.append(stuck.wait(60.0))
    channel = Channel(address, heard, open_bus=lambda _: bus)
    for number in range(20):
        channel.send([(joint, Frame(number, bytes(8))) for joint in range(14)])
        time.sleep(0.005)
    assert returned == [], "the driver's first call has not come back"
    stuck.set()
    channel.close()
    assert channel.tx_full is not NEVER


def test_a_multicast_sender_does_not_hear_itself(heard, bus):
    def echo(message):
        bus.incoming.put(_message(message.arbitration_id, bytes(message.data)))

    bus.on_send = echo
    channel = Channel(BusAddress("udp_multicast", "239.74.163.2"), heard, open_bus=lambda _: bus)
    channel.send([("left", FRAME)])
    assert wait_until(lambda: len(bus.sent) == 1)
    bus.incoming.put(_message())  # the same frame once more: this one is another host's
    assert wait_until(lambda: bool(heard.frames))
    channel.close()
    assert [frame for frame, _ in heard.frames] == [FRAME]
