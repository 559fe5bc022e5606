import threading
import time

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.outbox import Outbox


def _frame(number):
    return Frame(number, bytes(8))


def _drain(outbox):
    numbers = []
    while (item := outbox.take(0.0)) is not None:
        numbers.append(item[1].arbitration_id)
        outbox.sent(item[0])
    return numbers


def test_frames_leave_in_the_order_of_their_arrival():
    outbox = Outbox(8)
    outbox.put([(None, _frame(1)), ("left", _frame(2)), (None, _frame(3))])
    assert not outbox.is_empty
    assert _drain(outbox) == [1, 2, 3]
    assert outbox.is_empty


def test_a_newer_command_takes_the_place_of_an_unsent_one():
    outbox = Outbox(8)
    outbox.put([("left", _frame(1)), ("right", _frame(2))])
    outbox.put([("left", _frame(3)), ("right", _frame(4))])
    assert _drain(outbox) == [3, 4]
    assert (outbox.superseded, outbox.overruns) == (2, 0)


def test_commands_replaced_although_none_has_left_for_long_are_an_overrun():
    now = [0.0]
    outbox = Outbox(8, lambda: now[0])
    for number in range(5):
        outbox.put([("left", _frame(number))])
        now[0] += 0.02
    assert (outbox.superseded, outbox.overruns) == (4, 0), "replaced for 60 ms"
    outbox.put([("left", _frame(5))])
    assert (outbox.superseded, outbox.overruns) == (5, 1)
    assert _drain(outbox) == [5]
    now[0] += 1.0
    outbox.put([("left", _frame(6))])
    outbox.put([("left", _frame(7))])
    assert outbox.overruns == 1, "since then one has left"


def test_a_full_outbox_drops_what_does_not_fit_and_counts_it():
    outbox = Outbox(3)
    outbox.put([(None, _frame(number)) for number in range(5)])
    assert outbox.overruns == 2
    assert _drain(outbox) == [0, 1, 2]


def test_a_full_outbox_still_takes_newer_commands_in_place_of_old_ones():
    outbox = Outbox(2)
    outbox.put([("left", _frame(1)), ("right", _frame(2))])
    outbox.put([("right", _frame(3))])
    assert _drain(outbox) == [1, 3]
    assert outbox.overruns == 0


def test_a_frame_that_could_not_leave_goes_first_again():
    outbox = Outbox(4)
    outbox.put([("left", _frame(1)), ("right", _frame(2))])
    key, frame, _ = outbox.take(0.0) or ("", _frame(0), 0.0)
    outbox.give_back(key, frame)
    assert _drain(outbox) == [1, 2]


def test_a_frame_that_could_not_leave_gives_way_to_a_newer_one():
    outbox = Outbox(4)
    outbox.put([("left", _frame(1))])
    key, frame, _ = outbox.take(0.0) or ("", _frame(0), 0.0)
    outbox.put([("left", _frame(2))])
    outbox.give_back(key, frame)
    assert _drain(outbox) == [2]
    assert outbox.superseded == 1


def test_taking_waits_for_a_frame_and_no_longer():
    outbox = Outbox(4)
    timer = threading.Timer(0.02, outbox.put, [[("left", _frame(1))]])
    timer.start()
    item = outbox.take(5.0)
    timer.join()
    assert item is not None
    begin = time.monotonic()
    assert outbox.take(0.02) is None
    assert 0.015 < time.monotonic() - begin < 1.0


def test_a_closed_outbox_gives_what_waits_and_takes_no_more():
    outbox = Outbox(4)
    outbox.put([("left", _frame(1))])
    outbox.close()
    outbox.put([("right", _frame(2))])
    outbox.give_back("x", _frame(3))
    assert outbox.is_closed
    assert _drain(outbox) == [1]
    assert outbox.take(60.0) is None


def test_a_frame_that_outlived_its_lifetime_is_dropped_and_counted():
    now = [0.0]
    outbox = Outbox(8, lambda: now[0])
    outbox.put([("left", _frame(1)), ("right", _frame(2))], lifetime=0.04)
    outbox.put([("stop", _frame(3))])
    now[0] = 0.03
    outbox.put([("right", _frame(4))], lifetime=0.04)
    now[0] = 0.06
    assert _drain(outbox) == [4, 3]
    assert outbox.stale == 1


def test_a_frame_that_is_given_back_keeps_its_time():
    now = [0.0]
    outbox = Outbox(8, lambda: now[0])
    outbox.put([("left", _frame(1))], lifetime=0.04)
    item = outbox.take(0.0)
    assert item is not None
    outbox.give_back(*item)
    now[0] = 0.05
    assert _drain(outbox) == []
