"""Laws of the codec: round trips within a step, and a decoder that nothing upsets."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import (
    RobstrideEncoder,
    decode_command,
    decode_reply,
    encode_command,
    encode_reply,
)
from humanoid_sim.hardware.robstride.messages import (
    SIGNED_STEPS,
    UNSIGNED_STEPS,
    FaultBit,
    FrameType,
    MotorMode,
    StatusFault,
    WarningBit,
    join_identifier,
)
from humanoid_sim.robots.motors import MOTORS

_HOST = 0xFD

_models = st.sampled_from(list(MOTORS.values()))
_motor_ids = st.integers(1, 127)
_hosts = st.integers(0, 255)
_fractions = st.floats(-1.0, 1.0)
_gains = st.floats(0.0, 1.0)
_payloads = st.binary(min_size=4, max_size=4)
_indices = st.integers(0, 0xFFFF)

_plain_commands = st.one_of(
    st.builds(messages.GetDeviceId, _motor_ids, host_id=_hosts),
    st.builds(messages.Enable, _motor_ids, host_id=_hosts),
    st.builds(messages.Stop, _motor_ids, st.booleans(), host_id=_hosts),
    st.builds(messages.ReadVersion, _motor_ids, host_id=_hosts),
    st.builds(messages.SetZero, _motor_ids, host_id=_hosts),
    st.builds(messages.SetDeviceId, _motor_ids, _motor_ids, host_id=_hosts),
    st.builds(messages.ReadParameter, _motor_ids, _indices, host_id=_hosts),
    st.builds(messages.WriteParameter, _motor_ids, _indices, _payloads, host_id=_hosts),
    st.builds(messages.SaveParameters, _motor_ids, host_id=_hosts),
    st.builds(messages.SetActiveReport, _motor_ids, st.booleans(), host_id=_hosts),
    st.builds(messages.SetBaudRate, _motor_ids, st.sampled_from(messages.BaudRate), host_id=_hosts),
    st.builds(messages.SetProtocol, _motor_ids, st.sampled_from(messages.Protocol), host_id=_hosts),
)
_plain_replies = st.one_of(
    st.builds(
        messages.FaultReport, _motor_ids, _hosts, st.integers(0, 2**32 - 1).map(FaultBit), st.just(WarningBit(1))
    ),
    st.builds(messages.ParameterReply, _motor_ids, _hosts, _indices, _payloads, st.booleans()),
    st.builds(messages.Version, _motor_ids, _hosts, st.tuples(*[st.integers(0, 255)] * 4)),
    st.builds(messages.DeviceId, _motor_ids, st.binary(min_size=8, max_size=8)),
)
_frames = st.builds(
    Frame,
    st.integers(0, 2**29 - 1)
    | st.builds(join_identifier, st.sampled_from(FrameType), st.integers(0, 255), _motor_ids, st.just(_HOST)),
    st.binary(max_size=8),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)


@given(_plain_commands, _models)
def test_commands_survive_the_bus(command, model):
    assert decode_command(encode_command(command, model), command.motor_id, model) == command


@given(_plain_replies, _models)
def test_replies_survive_the_bus(reply, model):
    host = getattr(reply, "host_id", _HOST)
    frame = encode_reply(reply, model)
    assert decode_reply(frame, {reply.motor_id: model}, host) == reply


@given(_models, _motor_ids, st.tuples(_fractions, _fractions, _fractions, _gains, _gains))
def test_operation_control_loses_less_than_a_step(model, motor_id, shares):
    limits = [model.position, model.velocity, model.effort, model.stiffness, model.damping]
    sent = messages.OperationControl(motor_id, *(share * limit for share, limit in zip(shares, limits, strict=True)))
    read = decode_command(encode_command(sent, model), motor_id, model)
    assert isinstance(read, messages.OperationControl)
    steps = [SIGNED_STEPS] * 3 + [UNSIGNED_STEPS] * 2
    for field, limit, count in zip(fields(sent)[1:], limits, steps, strict=True):
        lost = getattr(sent, field.name) - getattr(read, field.name)
        assert -1e-9 * limit <= lost <= limit / count * (1.0 + 1e-9), field.name


@given(_models, _motor_ids, st.lists(st.floats(-1e300, 1e300), min_size=5, max_size=5))
def test_any_finite_command_has_a_frame_and_both_encoders_agree(model, motor_id, values):
    frame = encode_command(messages.OperationControl(motor_id, *values), model)
    assert len(frame.data) == 8
    assert RobstrideEncoder([motor_id], [model]).encode(np.array(values)[:, None]).frames == ((0, 0, frame),)
    read = decode_command(frame, motor_id, model)
    assert isinstance(read, messages.OperationControl)
    assert abs(read.position) <= model.position
    assert abs(read.velocity) <= model.velocity
    assert abs(read.effort) <= model.effort
    assert 0.0 <= read.stiffness <= model.stiffness
    assert 0.0 <= read.damping <= model.damping


@given(
    _models,
    _motor_ids,
    _hosts,
    st.tuples(_fractions, _fractions, _fractions),
    st.integers(0, 65535),
    st.sampled_from(MotorMode),
    st.integers(0, 63),
    st.booleans(),
)
def test_statuses_lose_less_than_a_step(model, motor_id, host, shares, temperature, mode, faults, is_report):
    limits = (model.position, model.velocity, model.effort)
    position, velocity, effort = (share * limit for share, limit in zip(shares, limits, strict=True))
    sent = messages.Status(
        motor_id, host, position, velocity, effort, temperature / 10, mode, StatusFault(faults), is_report
    )
    read = decode_reply(encode_reply(sent, model), {motor_id: model}, host)
    assert isinstance(read, messages.Status)
    assert (read.temperature, read.mode, read.faults, read.is_report) == (temperature / 10, mode, faults, is_report)
    for name, limit in zip(("position", "velocity", "effort"), limits, strict=True):
        lost = getattr(sent, name) - getattr(read, name)
        assert -1e-9 * limit <= lost <= limit / SIGNED_STEPS * (1.0 + 1e-9), name


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


@pytest.mark.parametrize(
    ("kind", "destination", "expected"),
    [
        (FrameType.STATUS, 0x11, messages.Ignored(messages.IgnoredReason.OTHER_HOST, 11)),
        (FrameType.READ_PARAMETER, 0x7E, messages.Ignored(messages.IgnoredReason.OTHER_HOST, 11)),
        (FrameType.READ_PARAMETER, 12, messages.Ignored(messages.IgnoredReason.HOST_COMMAND, 12)),
        (FrameType.ACTIVE_REPORT, 12, messages.Ignored(messages.IgnoredReason.HOST_COMMAND, 12)),
        (FrameType.ENABLE, 12, messages.Ignored(messages.IgnoredReason.HOST_COMMAND, 12)),
        (FrameType.GET_DEVICE_ID, 12, messages.Ignored(messages.IgnoredReason.HOST_COMMAND, 12)),
        (8, _HOST, messages.Ignored(messages.IgnoredReason.UNKNOWN_TYPE, 11)),
    ],
)
def test_who_a_frame_concerns(kind, destination, expected):
    models = {11: MOTORS["rs-02"], 12: MOTORS["rs-02"]}
    assert decode_reply(Frame(join_identifier(kind, 0, 11, destination), bytes(8)), models, _HOST) == expected


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (messages.Enable(0), "Enable.motor_id: is 0, expected 1 to 127"),
        (messages.Enable(128), "Enable.motor_id: is 128, expected 1 to 127"),
        (messages.Enable(1, host_id=256), "Enable.host_id: is 256, expected 0 to 255"),
        (messages.SetDeviceId(1, 0), "SetDeviceId.new_id: is 0, expected 1 to 127"),
        (messages.ReadParameter(1, 0x10000), "ReadParameter.index: is 65536, expected 0 to 0xFFFF"),
        (messages.WriteParameter(1, 0x7005, b"\0"), "WriteParameter.payload: has 1 bytes, expected 4"),
    ],
)
def test_commands_that_have_no_frame(command, message):
    with pytest.raises(FieldError) as raised:
        encode_command(command, MOTORS["rs-02"])
    assert str(raised.value) == message


def test_the_bus_encoder_refuses_an_id_that_is_none():
    with pytest.raises(FieldError, match="is 128, expected 1 to 127"):
        RobstrideEncoder([128], [MOTORS["rs-02"]])


def test_settings_that_do_not_exist_are_malformed_on_the_motor():
    def told(kind, setting):
        return decode_command(
            Frame(join_identifier(kind, 0, _HOST, 5), bytes([1, 2, 3, 4, 5, 6, setting, 0])), 5, model
        )

    model = MOTORS["rs-02"]
    assert isinstance(told(FrameType.SET_BAUD_RATE, 5), messages.Malformed)
    assert isinstance(told(FrameType.SET_PROTOCOL, 3), messages.Malformed)
    assert isinstance(told(FrameType.ACTIVE_REPORT, 2), messages.Malformed)
    assert told(FrameType.SET_BAUD_RATE, 1) == messages.SetBaudRate(5, messages.BaudRate.KBIT_1000)
