"""The length of frames and arbitration against a bit-by-bit implementation, and the figures of the protocol notes."""

from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.bus.frame import FRAME_BITS, Frame, arbitration_key, bus_load, frame_bits


def _stream(frame):
    """The stuffed part of a frame without its stuff bits, from the start of frame to the checksum, bit by bit."""

    def bits(value, count):
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


def _naive_bits(frame):
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
def test_the_length_is_that_of_the_bit_stream(frame):
    assert frame_bits(frame) == _naive_bits(frame)


@given(st.integers(0, (1 << 29) - 1), st.binary(min_size=8, max_size=8))
def test_motors_frames_take_131_to_160_bits(number, data):
    assert 131 <= frame_bits(Frame(number, data)) <= 160


def test_alternating_bits_need_no_stuffing_and_zeros_much():
    assert frame_bits(Frame(0x0AAAAAAA, b"\xaa" * 8)) == 131
    assert frame_bits(Frame(0, bytes(8))) == 150


@given(_FRAMES, _FRAMES)
def test_the_first_differing_bit_on_the_wire_decides(first, second):
    def arbitration(frame):
        return _stream(frame)[: 33 if frame.is_extended else 14]  # up to RTR, and for 11-bit frames IDE

    one, other = arbitration(first), arbitration(second)
    length = min(len(one), len(other))
    if one[:length] != other[:length]:
        assert (arbitration_key(first) < arbitration_key(second)) == (one[:length] < other[:length])


def test_the_limits_of_a_motors_frame_are_131_and_160_bits():
    assert FRAME_BITS == (131, 160)


def test_fourteen_motors_at_200_hz_fill_a_bus_to_what_the_protocol_notes_say():
    assert 0.73 < bus_load(200.0 * 2 * 14) < 0.90
    assert bus_load(0.0) == 0.0


def test_frames_print_as_candump_has_them():
    assert str(Frame(0x1FE, bytes(2))) == "000001FE#0000"
    assert str(Frame(0x1FE, b"\xab", is_extended=False)) == "1FE#AB"
