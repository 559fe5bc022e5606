"""CDR: alignment as the standard says it, every value back, and no wrong byte taken for a message."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_samples import any_float, bits

from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, CdrReader, CdrWriter, layout


@pytest.mark.parametrize(
    ("codes", "start", "size"),
    [("d", 0, 8), ("Bd", 0, 16), ("d", 4, 12), ("BHI", 0, 8), ("IB", 0, 5), ("?d", 7, 9), ("Qdd", 0, 24)],
)
def test_a_layout_pads_to_each_size(codes, start, size):
    assert layout(codes, start).size == size


def test_known_bytes():
    writer = CdrWriter()
    writer.string("ab")
    writer.pack("d", 1.0)
    writer.array(np.array([], dtype=np.float64))
    writer.array(np.array([2.0]))
    assert writer.message() == (
        ENCAPSULATION
        + b"\x03\x00\x00\x00ab\x00"
        + b"\x00"  # to 8
        + b"\x00\x00\x00\x00\x00\x00\xf0\x3f"
        + b"\x00\x00\x00\x00"  # an empty sequence: no padding after its count
        + b"\x01\x00\x00\x00"
        + b"\x00\x00\x00\x00\x00\x00\x00\x40"
    )


FIELDS = st.one_of(
    st.tuples(st.just("d"), any_float),
    st.tuples(st.just("B"), st.integers(0, 255)),
    st.tuples(st.just("I"), st.integers(0, 2**32 - 1)),
    st.tuples(st.just("q"), st.integers(-(2**63), 2**63 - 1)),
    st.tuples(st.just("?"), st.booleans()),
    st.tuples(st.just("string"), st.text()),
    st.tuples(st.just("strings"), st.lists(st.text(), max_size=3).map(tuple)),
    st.tuples(st.just("float32"), st.binary(max_size=20).map(lambda data: np.frombuffer(data[: len(data) & ~3], "f4"))),
    st.tuples(st.just("float64"), st.binary(max_size=40).map(lambda data: np.frombuffer(data[: len(data) & ~7], "f8"))),
)


def write(fields, skip=0):
    writer = CdrWriter(skip)
    for kind, value in fields:
        if len(kind) == 1:
            writer.pack(kind, value)
        elif kind.startswith("string"):
            getattr(writer, kind)(value)
        else:
            writer.array(value)
    return writer


def read(message, kinds):
    reader = CdrReader(message)
    values = []
    for kind in kinds:
        if len(kind) == 1:
            values.append(reader.unpack(kind)[0])
        elif kind.startswith("string"):
            values.append(getattr(reader, kind)())
        else:
            values.append(reader.array(kind))
    reader.finish()
    return tuple(values)


@given(st.lists(FIELDS, max_size=8))
def test_round_trip(fields):
    message = write(fields).message()
    kinds, values = zip(*fields, strict=True) if fields else ((), ())
    assert bits(read(message, kinds)) == bits(values)


@given(st.lists(FIELDS, min_size=1, max_size=6), st.data())
def test_a_shorter_message_is_refused(fields, data):
    message = write(fields).message()
    length = data.draw(st.integers(0, len(message) - 1))
    with pytest.raises(CdrError):
        read(message[:length], [kind for kind, _ in fields])


@given(st.lists(FIELDS, max_size=5), st.lists(FIELDS, max_size=5))
def test_a_stretch_written_apart_is_the_same(before, after):
    whole = write([*before, *after]).body()
    front = write(before).body()
    skip = len(front) % 8
    assert front + write(after, skip).body() == whole


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (b"", "encapsulation header is missing"),
        (b"\x00\x00\x00\x00", "encapsulation header is 00 00 00 00"),
        (ENCAPSULATION + b"\xff\xff\xff\xff", "a string of 4294967295 bytes in 0"),
        (ENCAPSULATION + b"\x00\x00\x00\x00", "a string of 0 bytes"),
        (ENCAPSULATION + b"\x02\x00\x00\x00ab", "without its final NUL"),
        (ENCAPSULATION + b"\x02\x00\x00\x00\xff\x00", "not UTF-8"),
    ],
)
def test_a_wrong_string_is_refused(message, reason):
    with pytest.raises(CdrError, match=reason):
        CdrReader(message).string()
