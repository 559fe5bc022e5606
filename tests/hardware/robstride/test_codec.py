"""Laws of the codec: round trips within a step, and a decoder that nothing upsets."""

from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import (
    SIGNED_STEPS,
    UNSIGNED_STEPS,
    decode_command,
    decode_reply,
    encode_command,
)
from humanoid_sim.hardware.robstride.messages import FrameType, join_identifier
from humanoid_sim.robots.motors import MOTORS

_HOST = 0xFD

_models = st.sampled_from(list(MOTORS.values()))
_motor_ids = st.integers(1, 127)
_fractions = st.floats(-1.0, 1.0)
_gains = st.floats(0.0, 1.0)

_frames = st.builds(
    Frame,
    st.integers(0, 2**29 - 1)
    | st.builds(join_identifier, st.sampled_from(FrameType), st.integers(0, 255), _motor_ids, st.just(_HOST)),
    st.binary(max_size=8),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)


@given(_models, _motor_ids, st.tuples(_fractions, _fractions, _fractions, _gains, _gains))
def test_operation_control_loses_less_than_a_step(model, motor_id, shares):
    limits = [model.position, model.velocity, model.effort, model.stiffness, model.damping]
    sent = messages.OperationControl(motor_id, *(share * limit for share, limit in zip(shares, limits, strict=True)))
    read = decode_command(encode_command(sent, model), motor_id, model)
    assert isinstance(read, messages.OperationControl)
    steps = [SIGNED_STEPS] * 3 + [UNSIGNED_STEPS] * 2
    for name, limit, count in zip(sent.__struct_fields__[1:], limits, steps, strict=True):
        lost = getattr(sent, name) - getattr(read, name)
        assert -1e-9 * limit <= lost <= limit / count * (1.0 + 1e-9), name


@given(_frames)
def test_decoding_never_raises_and_never_invents_a_motor(frame):
    models = {11: MOTORS["rs-02"], 127: MOTORS["rs-05"]}
    reply = decode_reply(frame, models, _HOST)
    if isinstance(reply, messages.Status | messages.FaultReport | messages.ParameterReply | messages.Version):
        assert reply.motor_id in models
        assert frame.is_extended
        assert frame.arbitration_id >> 8 & 0xFF == reply.motor_id
        assert frame.arbitration_id & 0xFF == _HOST
    command = decode_command(frame, 11, MOTORS["rs-02"])
    if not isinstance(command, messages.Ignored):
        assert frame.arbitration_id & 0xFF == 11
