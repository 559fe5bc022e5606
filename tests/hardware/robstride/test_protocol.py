"""Laws of the protocol: round trips within a step, and a decoder that nothing upsets."""

from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.robstride.protocol import (
    DeviceId,
    FrameType,
    Ignored,
    decode_reply,
)
from humanoid_sim.robots.motors import MOTORS

_HOST = 0xFD
_replies = st.builds(
    lambda kind, high, motor_id: kind << 24 | high << 16 | motor_id << 8 | _HOST,
    st.sampled_from(FrameType),
    st.integers(0, 255),
    st.integers(1, 127),
)


@given(st.integers(0, 2**29 - 1) | _replies, st.binary(max_size=8), st.booleans(), st.booleans(), st.booleans())
def test_decoding_never_raises_and_never_invents_a_motor(number, data, is_extended, is_remote, is_error):
    models = {11: MOTORS["rs-02"], 127: MOTORS["rs-05"]}
    reply = decode_reply(Frame(number, data, is_extended, is_remote, is_error), models, _HOST)
    if not isinstance(reply, Ignored):
        assert is_extended
        assert number >> 8 & 0xFF == reply.motor_id
    if not isinstance(reply, Ignored | DeviceId) and number >> 24:
        assert reply.motor_id in models
        assert number & 0xFF == _HOST
