import errno
import itertools
import threading
import time

import can
import pytest
from scripted_bus import ScriptedBus, error_frame
from waiting import wait_until

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.channel import Channel, Outbox
from humanoid_sim.hardware.bus.events import BusEvent, ChannelCounters
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
    channel = Channel(address, heard, open_bus=lambda _: bus, capacity=32)
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


def test_kinds_of_frames_are_kept_apart(channel, heard, peer):
    peer.send(_message(0x123, is_extended_id=False))
    peer.send(can.Message(arbitration_id=0x123, is_remote_frame=True, dlc=4, timestamp=time.time()))
    assert wait_until(lambda: len(heard.frames) == 2)
    standard, remote = (frame for frame, _ in heard.frames)
    assert (standard.is_extended, standard.is_remote) == (False, False)
    assert (remote.is_extended, remote.is_remote, remote.data) == (True, True, b"")


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


def test_frames_of_other_processes_of_this_machine_count(heard, bus, scripted):
    bus.incoming.put(_message(is_rx=False))  # as SocketCAN marks them
    assert wait_until(lambda: bool(heard.frames))
    assert heard.frames[0][0] == FRAME


def test_what_does_not_fit_the_protocol_is_counted_only(heard, bus, scripted):
    bus.incoming.put(_message(data=bytes(12), is_fd=True))
    bus.incoming.put(_message())
    assert wait_until(lambda: bool(heard.frames))
    assert [frame for frame, _ in heard.frames] == [FRAME]
    assert scripted.counters.unusable == 1
    assert scripted.counters.received == 1


@pytest.mark.parametrize(
    ("message", "event"),
    [
        (error_frame(0x40), BusEvent.DOWN),
        (error_frame(0x20), BusEvent.ERROR),
        (error_frame(0x04, bytes([0, 2, 0, 0, 0, 0, 0, 0])), BusEvent.TX_FULL),
    ],
)
def test_an_error_frame_becomes_an_event(message, event, bus, scripted, heard):
    before = time.monotonic()
    bus.incoming.put(message)
    assert wait_until(lambda: scripted.counters.error_frames == 1)
    assert wait_until(lambda: bool(scripted.recent(event, before)))
    assert not heard.frames
    assert bool(scripted.down) is (event is BusEvent.DOWN)
    assert scripted.recent(event, time.monotonic()) == ""


def test_lost_arbitration_is_the_bus_at_work(bus, scripted):
    bus.incoming.put(error_frame(0x02))
    assert wait_until(lambda: scripted.counters.lost_arbitration == 1)
    assert scripted.counters.error_frames == 0
    assert not any(scripted.recent(event, 0.0) for event in BusEvent)


def test_an_interface_that_goes_down_is_reported_and_reading_goes_on(bus, scripted, heard):
    bus.incoming.put(can.CanOperationError("Error receiving: Network is down", error_code=errno.ENETDOWN))
    bus.incoming.put(_message())
    assert wait_until(lambda: bool(heard.frames))
    assert "receiving fails: Error receiving: Network is down" in scripted.down
    assert scripted.counters.receive_errors == 1


def test_one_failure_to_receive_is_a_bus_error_and_many_are_a_bus_that_is_down(bus, scripted):
    bus.incoming.put(can.CanOperationError("could not unpack received message"))
    assert wait_until(lambda: bool(scripted.recent(BusEvent.ERROR, 0.0)))
    assert scripted.down == ""
    bus.fails_always = AssertionError("a driver's own")
    assert wait_until(lambda: bool(scripted.down))
    assert "a driver's own" in scripted.down


def test_a_handler_that_raises_loses_one_frame_and_says_so(address, bus):
    taken = []

    def receive(frame, _):
        if not frame.data:
            raise ZeroDivisionError("bug")
        taken.append(frame)

    channel = Channel(address, receive, open_bus=lambda _: bus)
    bus.incoming.put(_message(data=b""))
    bus.incoming.put(_message())
    assert wait_until(lambda: bool(taken))
    channel.close()
    assert channel.counters.receiver_failures == 1
    assert "ZeroDivisionError: bug" in channel.recent(BusEvent.UNREADABLE, 0.0)


def test_a_full_kernel_queue_is_tried_again_until_there_is_room(bus, scripted):
    refusals = iter([True, True, False])

    def full(_):
        if next(refusals, False):
            raise can.CanOperationError("Failed to transmit", error_code=errno.ENOBUFS)

    bus.on_send = full
    scripted.send([("left", FRAME)])
    assert wait_until(lambda: scripted.counters.sent == 1)
    assert scripted.counters.retries == 2
    assert scripted.recent(BusEvent.TX_FULL, 0.0) == "", "it recovered within the control period"
    assert [message.arbitration_id for message in bus.sent] == [FRAME.arbitration_id]


def test_a_kernel_queue_that_stays_full_for_most_of_a_period_is_an_event(bus, scripted):
    refused_at = []

    def full(_):
        refused_at.append(time.monotonic())
        raise can.CanOperationError("Failed to transmit", error_code=errno.ENOBUFS)

    bus.on_send = full
    scripted.send([("left", FRAME)])
    assert wait_until(lambda: bool(scripted.recent(BusEvent.TX_FULL, 0.0)))
    bus.on_send = lambda _: None
    assert scripted.recent(BusEvent.TX_FULL, refused_at[0] + 0.016).startswith("outgoing queue is full")


def test_a_jam_that_never_empties_is_an_event_although_frames_leave(bus, scripted):
    """A bus that takes every second frame and is offered more than it takes."""
    refusals = itertools.cycle([True, False])

    def saturated(_):
        if next(refusals):
            raise can.CanOperationError("Failed to transmit", error_code=errno.ENOBUFS)

    bus.on_send = saturated
    number = itertools.count()
    assert wait_until(
        lambda: (
            scripted.send([(None, Frame(next(number), bytes(8)))] * 2) or bool(scripted.recent(BusEvent.TX_FULL, 0.0))
        )
    )
    assert scripted.counters.sent > 0


def test_a_command_that_was_queued_before_the_process_stood_still_never_leaves(bus, scripted):
    entered, stuck = threading.Event(), threading.Event()

    def suspended(_):
        entered.set()
        stuck.wait(5.0)

    bus.on_send = suspended
    scripted.send([("left", Frame(1, bytes(8)))], 0.04)
    assert entered.wait(5.0)
    scripted.send([("right", Frame(2, bytes(8)))], 0.04)
    scripted.send([("question", Frame(3, bytes(8)))])
    time.sleep(0.05)
    stuck.set()
    assert wait_until(lambda: len(bus.sent) == 2)
    assert [message.arbitration_id for message in bus.sent] == [1, 3]
    assert wait_until(lambda: scripted.counters.stale == 1)


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
    assert scripted.counters.retries == 1


def test_a_frame_that_cannot_leave_an_interface_that_is_down_never_leaves(bus, scripted):
    down = True

    def refuse(_):
        if down:
            raise can.CanOperationError("Failed to transmit: Network is down", error_code=errno.ENETDOWN)

    bus.on_send = refuse
    scripted.send([("left", FRAME)])
    assert wait_until(lambda: bool(scripted.down))
    down = False
    scripted.send([("left", Frame(2, bytes(8)))])
    assert wait_until(lambda: scripted.counters.sent == 1)
    assert [message.arbitration_id for message in bus.sent] == [2]
    assert "Network is down" in scripted.down


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
    assert channel.counters.overruns > 0


def test_closing_sends_what_waits(channel, peer):
    channel.send([(None, Frame(number, bytes(8))) for number in range(50)])
    channel.close()
    channel.close()
    received = [message.arbitration_id for _ in range(50) if (message := peer.recv(0.1)) is not None]
    assert received == list(range(50))


def test_a_bus_that_cannot_be_opened_leaves_nothing_behind(address, heard):
    def refuse(_):
        raise RobotError("no such adapter")

    threads = threading.active_count()
    with pytest.raises(RobotError, match="no such adapter"):
        Channel(address, heard, open_bus=refuse)
    assert threading.active_count() == threads


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


def _frame(number):
    return Frame(number, bytes(8))


def _drain(outbox):
    numbers = []
    while (item := outbox.take(0.0)) is not None:
        numbers.append(item[1].arbitration_id)
        outbox.sent(item[0])
    return numbers


def test_frames_leave_in_the_order_of_their_arrival():
    outbox = Outbox(8, ChannelCounters())
    outbox.put([(None, _frame(1)), ("left", _frame(2)), (None, _frame(3))])
    assert not outbox.is_empty
    assert _drain(outbox) == [1, 2, 3]
    assert outbox.is_empty


def test_a_newer_command_takes_the_place_of_an_unsent_one():
    outbox = Outbox(8, ChannelCounters())
    outbox.put([("left", _frame(1)), ("right", _frame(2))])
    outbox.put([("left", _frame(3)), ("right", _frame(4))])
    assert _drain(outbox) == [3, 4]
    assert (outbox.counters.superseded, outbox.counters.overruns) == (2, 0)


def test_commands_replaced_although_none_has_left_for_long_are_an_overrun():
    now = [0.0]
    outbox = Outbox(8, ChannelCounters(), lambda: now[0])
    for number in range(5):
        outbox.put([("left", _frame(number))])
        now[0] += 0.02
    assert (outbox.counters.superseded, outbox.counters.overruns) == (4, 0), "replaced for 60 ms"
    outbox.put([("left", _frame(5))])
    assert (outbox.counters.superseded, outbox.counters.overruns) == (5, 1)
    assert _drain(outbox) == [5]
    now[0] += 1.0
    outbox.put([("left", _frame(6))])
    outbox.put([("left", _frame(7))])
    assert outbox.counters.overruns == 1, "since then one has left"


def test_a_full_outbox_drops_what_does_not_fit_and_counts_it():
    outbox = Outbox(3, ChannelCounters())
    outbox.put([(None, _frame(number)) for number in range(5)])
    assert outbox.counters.overruns == 2
    assert _drain(outbox) == [0, 1, 2]


def test_a_full_outbox_still_takes_newer_commands_in_place_of_old_ones():
    outbox = Outbox(2, ChannelCounters())
    outbox.put([("left", _frame(1)), ("right", _frame(2))])
    outbox.put([("right", _frame(3))])
    assert _drain(outbox) == [1, 3]
    assert outbox.counters.overruns == 0


def test_a_frame_that_could_not_leave_goes_first_again():
    outbox = Outbox(4, ChannelCounters())
    outbox.put([("left", _frame(1)), ("right", _frame(2))])
    key, frame, _ = outbox.take(0.0) or ("", _frame(0), 0.0)
    outbox.give_back(key, frame)
    assert _drain(outbox) == [1, 2]


def test_a_frame_that_could_not_leave_gives_way_to_a_newer_one():
    outbox = Outbox(4, ChannelCounters())
    outbox.put([("left", _frame(1))])
    key, frame, _ = outbox.take(0.0) or ("", _frame(0), 0.0)
    outbox.put([("left", _frame(2))])
    outbox.give_back(key, frame)
    assert _drain(outbox) == [2]
    assert outbox.counters.superseded == 1


@pytest.mark.soak
def test_taking_waits_for_a_frame_and_no_longer():
    outbox = Outbox(4, ChannelCounters())
    timer = threading.Timer(0.02, outbox.put, [[("left", _frame(1))]])
    timer.start()
    item = outbox.take(5.0)
    timer.join()
    assert item is not None
    begin = time.monotonic()
    assert outbox.take(0.02) is None
    assert 0.015 < time.monotonic() - begin < 1.0


def test_a_closed_outbox_gives_what_waits_and_takes_no_more():
    outbox = Outbox(4, ChannelCounters())
    outbox.put([("left", _frame(1))])
    outbox.close()
    outbox.put([("right", _frame(2))])
    outbox.give_back("x", _frame(3))
    assert outbox.is_closed
    assert _drain(outbox) == [1]
    assert outbox.take(60.0) is None


def test_a_frame_that_outlived_its_lifetime_is_dropped_and_counted():
    now = [0.0]
    outbox = Outbox(8, ChannelCounters(), lambda: now[0])
    outbox.put([("left", _frame(1)), ("right", _frame(2))], lifetime=0.04)
    outbox.put([("stop", _frame(3))])
    now[0] = 0.03
    outbox.put([("right", _frame(4))], lifetime=0.04)
    now[0] = 0.06
    assert _drain(outbox) == [4, 3]
    assert outbox.counters.stale == 1


def test_a_frame_that_is_given_back_keeps_its_time():
    now = [0.0]
    outbox = Outbox(8, ChannelCounters(), lambda: now[0])
    outbox.put([("left", _frame(1))], lifetime=0.04)
    item = outbox.take(0.0)
    assert item is not None
    outbox.give_back(*item)
    now[0] = 0.05
    assert _drain(outbox) == []
