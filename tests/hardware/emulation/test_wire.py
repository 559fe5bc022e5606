"""Bus time and arbitration against a bit-by-bit implementation, and the figures of the protocol notes."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.emulation.wire import HOST, Wire, arbitration_key, frame_bits
from humanoid_sim.hardware.robstride.frames import Frame

_BIT = 1e-6


def _stream(frame: Frame) -> list[int]:
    """The stuffed part of a frame without its stuff bits, from the start of frame to the checksum, bit by bit."""

    def bits(value: int, count: int) -> list[int]:
        return [value >> shift & 1 for shift in range(count - 1, -1, -1)]

    remote = int(frame.is_remote)
    if frame.is_extended:
        head = [0, *bits(frame.arbitration_id >> 18, 11), 1, 1, *bits(frame.arbitration_id & 0x3FFFF, 18), remote, 0, 0]
    else:
        head = [0, *bits(frame.arbitration_id, 11), remote, 0, 0]
    stream = head + bits(len(frame.data), 4)
    if not frame.is_remote:
        stream += [bit for byte in frame.data for bit in bits(byte, 8)]
    crc = 0
    for bit in stream:
        crc_next = bit ^ (crc >> 14 & 1)
        crc = (crc << 1) & 0x7FFF
        if crc_next:
            crc ^= 0x4599
    return stream + bits(crc, 15)


def _naive_bits(frame: Frame) -> int:
    stream, sent = _stream(frame), []
    for bit in stream:
        sent.append(bit)
        if len(sent) >= 5 and len(set(sent[-5:])) == 1:
            sent.append(1 - bit)
    return len(sent) + 13


_FRAMES = st.builds(
    lambda extended, number, data, remote: Frame(number if extended else number & 0x7FF, data, extended, remote),
    st.booleans(),
    st.integers(0, (1 << 29) - 1),
    st.binary(max_size=8),
    st.booleans(),
)


@given(_FRAMES)
def test_the_length_is_that_of_the_bit_stream(frame: Frame) -> None:
    assert frame_bits(frame) == _naive_bits(frame)


@given(st.integers(0, (1 << 29) - 1), st.binary(min_size=8, max_size=8))
def test_motors_frames_take_131_to_160_bits(number: int, data: bytes) -> None:
    assert 131 <= frame_bits(Frame(number, data)) <= 160


def test_alternating_bits_need_no_stuffing_and_zeros_much() -> None:
    assert frame_bits(Frame(0x0AAAAAAA, b"\xaa" * 8)) == 131
    assert frame_bits(Frame(0, bytes(8))) == 150


@given(_FRAMES, _FRAMES)
def test_the_first_differing_bit_on_the_wire_decides(first: Frame, second: Frame) -> None:
    def arbitration(frame: Frame) -> list[int]:
        return _stream(frame)[: 33 if frame.is_extended else 14]  # up to RTR, and for 11-bit frames IDE

    one, other = arbitration(first), arbitration(second)
    length = min(len(one), len(other))
    if one[:length] != other[:length]:
        assert (arbitration_key(first) < arbitration_key(second)) == (one[:length] < other[:length])


def _run(wire: Wire) -> list[tuple[float, int, int]]:
    done = []
    while math.isfinite(wire.next_time):
        sent = wire.step()
        if sent is not None:
            done.append((sent.time, sent.node, sent.frame.arbitration_id))
    return done


def test_frames_of_one_node_keep_their_order_and_the_least_identifier_of_the_nodes_goes_first() -> None:
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


def test_a_frame_on_the_bus_is_not_interrupted() -> None:
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


def test_a_bus_without_bus_time_keeps_the_order_of_submission() -> None:
    wire = Wire(0)
    wire.submit(HOST, Frame(0x01800011, bytes(8)), 0.001)
    wire.submit(0, Frame(0x000012FE, bytes(8)), 0.002)
    assert _run(wire) == [(0.001, HOST, 0x01800011), (0.002, 0, 0x000012FE)]
    assert wire.busy == 0.0


def test_clearing_forgets_what_was_waiting_and_what_was_on_the_bus() -> None:
    wire = Wire(1 / _BIT)
    wire.submit(HOST, Frame(0x01800011, bytes(8)), 0.0)
    wire.submit(HOST, Frame(0x01800012, bytes(8)), 0.0)
    wire.step()
    assert wire.waiting(HOST) == 1
    wire.clear()
    assert wire.waiting(HOST) == 0
    assert math.isinf(wire.next_time)
