"""The order and the times of frames on a bus, and what becomes of them while faults are active."""

import math

import pytest

from humanoid_sim.hardware.bus.frame import Frame, frame_bits
from humanoid_sim.hardware.emulation.wire import HOST, FrameFaults, Wire

_BIT = 1e-6
_FRAMES = [Frame(0x02000BFD, bytes([i] * 8)) for i in range(100)]


def _run(wire):
    done = []
    while math.isfinite(wire.next_time):
        sent = wire.step()
        if sent is not None:
            done.append((sent.time, sent.node, sent.frame.arbitration_id))
    return done


def test_frames_of_one_node_keep_their_order_and_the_least_identifier_of_the_nodes_goes_first():
    wire = Wire(1 / _BIT)
    wire.submit(HOST, Frame(0x01800011, bytes(8)), 0.0)
    wire.submit(HOST, Frame(0x01700012, bytes(8)), 0.0)
    wire.submit(0, Frame(0x020011FD, bytes(8)), 0.0)
    wire.submit(1, Frame(0x000012FE, bytes(8)), 0.0)
    assert [(node, number) for _, node, number in _run(wire)] == [
        (1, 0x000012FE),
        (HOST, 0x01800011),
        (HOST, 0x01700012),
        (0, 0x020011FD),
    ]


def test_a_frame_on_the_bus_is_not_interrupted():
    wire = Wire(1 / _BIT)
    late, early = Frame(0x020011FD, bytes(8)), Frame(0x01800011, bytes(8))
    wire.submit(0, late, 0.0)
    wire.submit(HOST, early, 10 * _BIT)
    first, second = _run(wire)
    assert first[2] == late.arbitration_id
    assert first[0] == pytest.approx(frame_bits(late) * _BIT)
    assert second[0] == pytest.approx((frame_bits(late) + frame_bits(early)) * _BIT)
    assert wire.busy == pytest.approx(second[0])
    assert wire.frames == 2


def test_a_bus_without_bus_time_keeps_the_order_of_submission():
    wire = Wire(0)
    wire.submit(HOST, Frame(0x01800011, bytes(8)), 0.001)
    wire.submit(0, Frame(0x000012FE, bytes(8)), 0.002)
    assert _run(wire) == [(0.001, HOST, 0x01800011), (0.002, 0, 0x000012FE)]
    assert wire.busy == 0.0


def test_what_waits_passes_at_once_when_hurried_and_later_frames_take_their_time_again():
    wire = Wire(1 / _BIT)
    for node in range(3):
        wire.submit(node, Frame(0x02001100 + node, bytes(8)), 0.0)
    wire.hurry()
    assert [(at, node) for at, node, _ in _run(wire)] == [(0.0, 0), (0.0, 1), (0.0, 2)]
    later = Frame(0x020011FD, bytes(8))
    wire.submit(0, later, 1.0)
    assert _run(wire) == [(pytest.approx(1.0 + frame_bits(later) * _BIT), 0, later.arbitration_id)]


def test_clearing_forgets_what_was_waiting_and_what_was_on_the_bus():
    wire = Wire(1 / _BIT)
    wire.submit(HOST, Frame(0x01800011, bytes(8)), 0.0)
    wire.submit(HOST, Frame(0x01800012, bytes(8)), 0.0)
    wire.step()
    assert wire.waiting(HOST) == 1
    wire.clear()
    assert wire.waiting(HOST) == 0
    assert math.isinf(wire.next_time)


def _through(faults, motor=0):
    return [arrival for i, frame in enumerate(_FRAMES) for arrival in faults.arrivals(motor, frame, 0.01 * i)]


def _numbers(arrivals):
    return [frame.data[0] for _, frame in arrivals]


@pytest.fixture
def faults():
    return FrameFaults(seed=1)


def test_nothing_happens_without_a_fault_or_to_another_motor(faults):
    faults.set("lost", 1, 1.0)
    assert _through(faults, 0) == [(0.01 * i, frame) for i, frame in enumerate(_FRAMES)]
    assert _through(faults, 1) == []
    assert not faults.reaches(1)
    faults.set("lost", 1, None)
    assert len(_through(faults, 1)) == 100
    assert faults.reaches(1)


def test_some_are_lost(faults):
    faults.set("lost", 0, 0.2)
    assert 70 <= len(_through(faults)) <= 90
    assert 50 <= sum(faults.reaches(0) for _ in range(100)) <= 95


def test_they_are_late(faults):
    faults.set("delayed", 0, 0.3)
    assert faults.arrivals(0, _FRAMES[0], 1.0) == [(1.3, _FRAMES[0])]


def test_they_come_twice(faults):
    faults.set("duplicated", 0, 1.0)
    assert _numbers(_through(faults)) == [i for i in range(100) for _ in range(2)]


def test_neighbours_swap_and_none_is_lost(faults):
    faults.set("reordered", 0, 0.5)
    numbers = _numbers(_through(faults))
    faults.set("reordered", 0, None)
    numbers += _numbers(faults.arrivals(0, Frame(0x02000BFD, bytes([100] * 8)), 2.0))
    assert sorted(numbers) == list(range(101))
    assert numbers != sorted(numbers)
    assert max(abs(place - number) for place, number in enumerate(numbers)) == 1


def test_identifiers_and_lengths_are_damaged(faults):
    faults.set("corrupted_id", 0, 27)
    assert {frame.arbitration_id for _, frame in _through(faults)} == {0x0A000BFD}
    faults.set("corrupted_id", 0, None)
    faults.set("corrupted_dlc", 0, 5)
    assert {len(frame.data) for _, frame in _through(faults)} == {5}


def test_the_same_seed_gives_the_same_losses():
    runs = []
    for _ in range(2):
        faults = FrameFaults(seed=7)
        faults.set("lost", 0, 0.5)
        runs.append(_numbers(_through(faults)))
    assert runs[0] == runs[1]
