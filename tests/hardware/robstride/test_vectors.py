"""Every row of the golden vectors, `tests/data/robstride_vectors.csv`, whose columns the protocol's notes describe."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.mock.robstride_motor import RobstrideMotor
from humanoid_sim.hardware.robstride import protocol
from humanoid_sim.hardware.robstride.parameters import ParameterType, pack_value, unpack_value
from humanoid_sim.hardware.robstride.protocol import FrameType, flag_names
from humanoid_sim.robots.motors import MOTORS

with (Path(__file__).parents[2] / "data" / "robstride_vectors.csv").open(encoding="utf-8", newline="") as _file:
    _ALL_ROWS = tuple(csv.DictReader(_file))
_ANY_MODEL = MOTORS["rs-02"]
_HOST = 0xFD


def _rows(*kinds, count):
    found = [row for row in _ALL_ROWS if row["kind"] in kinds]
    assert len(found) == count
    return found


def _model(row):
    return MOTORS[row["model"]] if row["model"] else _ANY_MODEL


def _host(row):
    return int(row["host_id"], 16) if row["host_id"] else _HOST


def _frame(row, data_column="data_hex"):
    text = row[data_column]
    data = b"" if text == "<empty>" else bytes.fromhex(text)
    flags = row["frame_flags"]
    return Frame(int(row["arbitration_id_hex"], 16), data, row["is_extended"] == "1", flags == "rtr", flags == "err")


def _operation(row):
    return protocol.OperationControl(*(float(row[name]) for name in ("position", "velocity", "effort", "kp", "kd")))


def _motor(row):
    return int(row["can_id"])


def _index(row):
    return int(row["param_id_hex"], 16)


def _pack(row):
    text = row["value"]
    value = int(text) if text.lstrip("-").isdigit() else float(text)
    return pack_value(ParameterType[row["param_type"].upper()], value)


_PLAIN = {
    "cmd_enable": (FrameType.ENABLE, b""),
    "cmd_disable": (FrameType.STOP, b""),
    "cmd_clear_fault": (FrameType.STOP, protocol.CLEAR_FAULTS),
    "cmd_read_version": (FrameType.STOP, protocol.READ_VERSION),
    "cmd_get_device_id": (FrameType.GET_DEVICE_ID, b""),
    "cmd_set_device_id": (FrameType.SET_DEVICE_ID, b""),
    "cmd_set_zero": (FrameType.SET_ZERO, protocol.HERE),
    "cmd_save_parameters": (FrameType.SAVE_PARAMETERS, protocol.SAVE),
}
_COMMANDS = (*_PLAIN, "cmd_active_report", "cmd_read_parameter", "cmd_write_parameter")


def _command(row):
    match row["kind"]:
        case "cmd_active_report":
            return FrameType.ACTIVE_REPORT, protocol.REPORTS_ON if row["value"] == "1" else protocol.REPORTS_OFF
        case "cmd_read_parameter":
            return FrameType.READ_PARAMETER, protocol.parameter_data(_index(row))
        case "cmd_write_parameter":
            return FrameType.WRITE_PARAMETER, protocol.parameter_data(_index(row), _pack(row))
    return _PLAIN[row["kind"]]


def test_commands_encode_byte_for_byte():
    for row in _rows(*_COMMANDS, count=277):
        kind, data = _command(row)
        high = int(row["value"]) if kind == FrameType.SET_DEVICE_ID else 0
        frame = protocol.encode_command(kind, _motor(row), data, high=high, host_id=_host(row))
        assert frame == _frame(row), row["note"]


def test_operation_control_encodes_byte_for_byte_and_reads_as_the_reference_would():
    for row in _rows("encode_mit", count=200):
        frame = protocol.encode_operation(_motor(row), _operation(row), _model(row))
        assert frame == _frame(row), row["note"]
        read = protocol.decode_operation(frame, _model(row))
        expected = [float(row[f"dec_{name}"]) for name in ("position", "velocity", "effort", "kp", "kd")]
        assert list(read) == pytest.approx(expected, abs=1e-9)


def test_values_that_are_not_finite_are_refused():
    for row in _rows("encode_mit_nonfinite", count=15):
        with pytest.raises(FieldError, match=r"^OperationControl: is .*(nan|inf).*finite"):
            protocol.encode_operation(_motor(row), _operation(row), _model(row))


def test_parameter_values_that_do_not_fit_are_refused():
    for row in _rows("cmd_write_parameter_invalid", count=21):
        with pytest.raises(FieldError, match=row["value"].replace("+", r"\+")):
            _pack(row)


def test_a_motor_takes_the_forms_that_other_hosts_send():
    forms = [row for row in _rows(*_COMMANDS, count=277) if row["alt_data_hex"]]
    assert len(forms) > 80
    for row in forms:
        found = []
        for column in ("data_hex", "alt_data_hex"):
            motor = RobstrideMotor(_model(row), _motor(row), bytes(8))
            motor.sensed.shaft = 1.0
            replies = motor.receive(_frame(row, column), 1.0)
            assert replies, row["note"]
            state = motor.can_id, motor.is_running, motor.parameters, motor.stored, motor.origin, motor.next_report
            found.append((replies, state))
        assert found[0] == found[1]


def _decoded(row):
    return protocol.decode_reply(_frame(row), {_motor(row): _model(row)}, _host(row))


def test_statuses_and_active_reports():
    for row in _rows("decode_status", "decode_active_report", count=220):
        status = _decoded(row)
        assert isinstance(status, protocol.Status)
        assert status.motor_id == _motor(row)
        assert status.is_report == (row["expected"] == "active_report")
        for name in ("position", "velocity", "effort", "temperature"):
            assert getattr(status, name) == pytest.approx(float(row[f"dec_{name}"]), abs=1e-9)
        assert status.mode == int(row["dec_mode"])
        assert status.faults == int(row["dec_fault_bits"])
        assert "|".join(flag_names(status.faults)) == row["dec_faults"]
        frame = protocol.encode_reply(status, _model(row), _host(row))
        assert frame.arbitration_id == _frame(row).arbitration_id
        raw = np.frombuffer(frame.data, ">u2").astype(int)
        expected = np.frombuffer(_frame(row).data, ">u2").astype(int)
        expected[:3] = np.minimum(expected[:3], 65534)  # 65535 is never sent in this convention
        assert (expected - raw >= 0).all()
        assert (expected - raw <= [1, 1, 1, 0]).all()  # truncation of a decoded value may lose the last step


def test_fault_reports():
    for row in _rows("fault_report", count=40):
        report = _decoded(row)
        faults, warnings = int(row["dec_fault_bits"]), int(row["dec_warning_bits"])
        assert report == protocol.FaultReport(_motor(row), protocol.FaultBit(faults), protocol.WarningBit(warnings))
        names, _, warning_names = row["dec_faults"].partition("/")
        assert "|".join(flag_names(report.faults)) == names
        assert "|".join(flag_names(report.warnings)) == warning_names
        assert protocol.encode_reply(report, _model(row), _host(row)) == _frame(row)


def test_parameter_replies():
    for row in _rows("reply_read_parameter", count=44):
        reply = _decoded(row)
        if row["expected"] == "error:bad_dlc":
            assert isinstance(reply, protocol.Malformed)
            continue
        assert isinstance(reply, protocol.ParameterReply)
        assert (reply.motor_id, reply.index) == (_motor(row), _index(row))
        assert reply.is_success == (row["expected"] == "param_reply")
        assert protocol.encode_reply(reply, _model(row), _host(row)) == _frame(row)
        if not reply.is_success:
            continue
        value = unpack_value(ParameterType[row["param_type"].upper()], reply.payload)
        expected = np.float32(row["value"]) if row["param_type"] == "f32" else int(row["value"])
        assert value == expected or (math.isnan(value) and math.isnan(expected))


def test_device_ids_are_received_from_every_motor():
    for row in _rows("reply_get_device_id", count=9):
        reply = protocol.decode_reply(_frame(row), {}, _HOST)
        assert reply == protocol.DeviceId(_motor(row), bytes.fromhex(row["value"]))
        assert protocol.encode_reply(reply, _model(row)) == _frame(row)


def test_versions():
    for row in _rows("version_reply", count=3):
        assert _decoded(row) == protocol.Version(_motor(row), tuple(bytes.fromhex(row["value"])))


def _class_of(message):
    match message:
        case protocol.Ignored(reason):
            return f"ignore:{reason}"
        case protocol.Malformed():
            return "error:bad_dlc"
        case protocol.Status(is_report=is_report):
            return "active_report" if is_report else "status"
        case _:
            return type(message).__name__


def test_every_malformed_frame_gets_its_class_and_moves_no_motor():
    for row in _rows("malformed", count=57):
        assert _class_of(_decoded(row)) in row["expected"].split("|"), row["note"]
        if not row["expected"].startswith("ignore:host_command"):
            motor = RobstrideMotor(_ANY_MODEL, _motor(row), bytes(8))
            assert not motor.is_for(_frame(row)) or motor.receive(_frame(row), 1.0) == (), row["note"]


_replies = st.builds(
    lambda kind, high, motor_id: kind << 24 | high << 16 | motor_id << 8 | _HOST,
    st.sampled_from(FrameType),
    st.integers(0, 255),
    st.integers(1, 127),
)


@given(st.integers(0, 2**29 - 1) | _replies, st.binary(max_size=8), st.booleans(), st.booleans(), st.booleans())
def test_decoding_never_raises_and_never_invents_a_motor(number, data, is_extended, is_remote, is_error):
    models = {11: MOTORS["rs-02"], 127: MOTORS["rs-05"]}
    reply = protocol.decode_reply(Frame(number, data, is_extended, is_remote, is_error), models, _HOST)
    if not isinstance(reply, protocol.Ignored):
        assert is_extended
        assert number >> 8 & 0xFF == reply.motor_id
    if not isinstance(reply, protocol.Ignored | protocol.DeviceId) and number >> 24:
        assert reply.motor_id in models
        assert number & 0xFF == _HOST
