"""CDR by the definitions: every value comes back, and no wrong byte passes for a message."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, decode, encode
from humanoid_sim.ros2.definitions import FLOAT32_MULTI_ARRAY, JOINT_STATE, STRING, TF_MESSAGE

arrays = st.lists(st.floats(), max_size=4).map(np.array)
texts = st.text(max_size=6)
stamps = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
poses = st.tuples(*[st.floats()] * 7)
JOINT_STATES = st.tuples(stamps, texts, st.lists(texts, max_size=3), arrays, arrays, arrays)
TRANSFORMS = st.tuples(st.lists(st.tuples(stamps, texts, texts, poses), max_size=3))


def plain(values):
    """The values as they print: NaN equals NaN."""
    return repr([value.tolist() if isinstance(value, np.ndarray) else value for value in values])


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
    ("schema", "message", "reason"),
    [
        (STRING, b"", "encapsulation header is missing"),
        (STRING, b"\x00\x00\x00\x00", "encapsulation header is 00 00 00 00"),
        (STRING, ENCAPSULATION + b"\xff\xff\xff\xff", "a string of 4294967295 bytes in 0"),
        (STRING, ENCAPSULATION + b"\x00\x00\x00\x00", "a string of 0 bytes"),
        (STRING, ENCAPSULATION + b"\x02\x00\x00\x00ab", "without its final NUL"),
        (STRING, ENCAPSULATION + b"\x02\x00\x00\x00\xff\x00", "utf-8"),
        (STRING, ENCAPSULATION + b"\x01\x00\x00\x00\x00" + bytes(4), "4 bytes left"),
        (FLOAT32_MULTI_ARRAY, ENCAPSULATION + bytes(8) + b"\xff\xff\xff\xff", "buffer"),
    ],
)
def test_what_is_no_message_is_refused(schema, message, reason):
    with pytest.raises(CdrError, match=reason):
        decode(schema, message)
