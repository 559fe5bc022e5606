"""CDR by the definitions: known bytes, every value back, and no wrong byte taken for a message."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, decode, encode
from humanoid_sim.ros2.definitions import FLOAT32_MULTI_ARRAY, IMU, JOINT_STATE, STRING, TF_MESSAGE

arrays = st.lists(st.floats(), max_size=4).map(np.array)
texts = st.text(max_size=6)
stamps = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
poses = st.tuples(*[st.floats()] * 7)
JOINT_STATES = st.tuples(stamps, texts, st.lists(texts, max_size=3), arrays, arrays, arrays)
TRANSFORMS = st.tuples(st.lists(st.tuples(stamps, texts, texts, poses), max_size=3))


def plain(values):
    """The values as they print: NaN equals NaN."""
    return repr([value.tolist() if isinstance(value, np.ndarray) else value for value in values])


def test_known_bytes():
    assert encode(STRING, "ab") == ENCAPSULATION + b"\x03\x00\x00\x00ab\x00"
    message = encode(JOINT_STATE, (1, 2), "a", [], np.array([1.0]), [], [])
    assert message == (
        ENCAPSULATION
        + b"\x01\x00\x00\x00\x02\x00\x00\x00"
        + b"\x02\x00\x00\x00a\x00"
        + b"\x00\x00"  # to 4
        + b"\x00\x00\x00\x00"  # an empty sequence
        + b"\x01\x00\x00\x00"
        + b"\x00\x00\x00\x00\x00\x00\xf0\x3f"
        + b"\x00\x00\x00\x00"  # an empty sequence: no padding after its count
        + b"\x00\x00\x00\x00"
    )
    assert len(encode(IMU, (0, 0), "", range(37))) == 4 + 8 + 5 + 3 + 37 * 8


@given(JOINT_STATES)
def test_arrays_come_back(values):
    assert plain(decode(JOINT_STATE, encode(JOINT_STATE, *values))) == plain(values)


@given(TRANSFORMS)
def test_nested_messages_come_back(values):
    (found,) = decode(TF_MESSAGE, encode(TF_MESSAGE, *values))
    assert repr([tuple(item) for item in found]) == repr(values[0])


@given(JOINT_STATES, st.data())
def test_a_shorter_message_is_refused(values, data):
    message = encode(JOINT_STATE, *values)
    with pytest.raises(CdrError):
        decode(JOINT_STATE, message[: data.draw(st.integers(0, len(message) - 1))])


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (b"", "encapsulation header is missing"),
        (b"\x00\x00\x00\x00", "encapsulation header is 00 00 00 00"),
        (ENCAPSULATION + b"\xff\xff\xff\xff", "a string of 4294967295 bytes in 0"),
        (ENCAPSULATION + b"\x00\x00\x00\x00", "a string of 0 bytes"),
        (ENCAPSULATION + b"\x02\x00\x00\x00ab", "without its final NUL"),
        (ENCAPSULATION + b"\x02\x00\x00\x00\xff\x00", "utf-8"),
        (ENCAPSULATION + b"\x01\x00\x00\x00\x00" + bytes(4), "4 bytes left"),
    ],
)
def test_a_wrong_string_is_refused(message, reason):
    with pytest.raises(CdrError, match=reason):
        decode(STRING, message)


def test_an_array_longer_than_the_message_is_refused():
    with pytest.raises(CdrError):
        decode(FLOAT32_MULTI_ARRAY, ENCAPSULATION + bytes(8) + b"\xff\xff\xff\xff")
