"""Laws of the protocol: round trips within a step, and a decoder that nothing upsets."""

from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.robstride.protocol import (
    SIGNED_STEPS,
    UNSIGNED_STEPS,
    DeviceId,
    FrameType,
    Ignored,
    OperationControl,
    decode_operation,
    decode_reply,
    encode_operation,
)
from humanoid_sim.robots.motors import MOTORS

_HOST = 0xFD
_fractions = st.floats(-1.0, 1.0)
_gains = st.floats(0.0, 1.0)
_replies = st.builds(
    lambda kind, high, motor_id: kind << 24 | high << 16 | motor_id << 8 | _HOST,
    st.sampled_from(FrameType),
    st.integers(0, 255),
    st.integers(1, 127),
)


@given(st.sampled_from(list(MOTORS.values())), st.tuples(_fractions, _fractions, _fractions, _gains, _gains))
def test_operation_control_loses_less_than_a_step(model, shares):
    limits = [model.position, model.velocity, model.effort, model.stiffness, model.damping]
    sent = OperationControl(*(share * limit for share, limit in zip(shares, limits, strict=True)))
    read = decode_operation(encode_operation(11, sent, model), model)
    steps = [SIGNED_STEPS] * 3 + [UNSIGNED_STEPS] * 2
    for before, after, limit, count in zip(sent, read, limits, steps, strict=True):
        assert -1e-9 * limit <= before - after <= limit / count * (1.0 + 1e-9)


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
