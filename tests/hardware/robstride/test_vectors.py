"""Every row of the golden vectors, `tests/data/robstride_vectors.csv`, whose columns the protocol's notes describe."""

import csv
import math
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import (
    decode_command,
    decode_reply,
    encode_command,
    encode_reply,
)
from humanoid_sim.hardware.robstride.messages import flag_names
from humanoid_sim.hardware.robstride.parameters import ParameterType, pack_value, unpack_value
from humanoid_sim.robots.motors import MOTORS

_VECTORS = Path(__file__).parents[2] / "data" / "robstride_vectors.csv"
_ANY_MODEL = MOTORS["rs-02"]
_HOST = 0xFD


@cache
def _all_rows():
    with _VECTORS.open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


def _rows(*kinds, count):
    found = [row for row in _all_rows() if row["kind"] in kinds]
    assert len(found) == count
    return found


def _model(row):
    return MOTORS[row["model"]] if row["model"] else _ANY_MODEL


def _host(row):
    return int(row["host_id"], 16) if row["host_id"] else _HOST


def _frame(row):
    data = bytes.fromhex(row["data_hex"])
    flags = row["frame_flags"]
    return Frame(int(row["arbitration_id_hex"], 16), data, row["is_extended"] == "1", flags == "rtr", flags == "err")


def _number(text):
    return int(text) if text.lstrip("-").isdigit() else float(text)


def _operation_control(row):
    values = (float(row[name]) for name in ("position", "velocity", "effort", "kp", "kd"))
    return messages.OperationControl(_motor(row), *values)


_PLAIN = {
    "cmd_enable": messages.Enable,
    "cmd_disable": messages.Stop,
    "cmd_get_device_id": messages.GetDeviceId,
    "cmd_set_zero": messages.SetZero,
    "cmd_save_parameters": messages.SaveParameters,
    "cmd_read_version": messages.ReadVersion,
}
"""Commands that say nothing but to which motor, and who asks."""
_WITH_VALUE = {
    "cmd_clear_fault": lambda row, host: messages.Stop(_motor(row), clear_fault=True, host_id=host),
    "cmd_set_device_id": lambda row, host: messages.SetDeviceId(_motor(row), int(row["value"]), host_id=host),
    "cmd_active_report": lambda row, host: messages.SetActiveReport(_motor(row), row["value"] == "1", host_id=host),
    "cmd_read_parameter": lambda row, host: messages.ReadParameter(_motor(row), _index(row), host_id=host),
    "cmd_write_parameter": lambda row, host: messages.WriteParameter(
        _motor(row), _index(row), _payload(row), host_id=host
    ),
}
_COMMANDS = ("encode_mit", *_PLAIN, *_WITH_VALUE)


def _motor(row):
    return int(row["can_id"])


def _index(row):
    return int(row["param_id_hex"], 16)


def _payload(row):
    return pack_value(ParameterType[row["param_type"].upper()], _number(row["value"]))


def _command(row):
    kind, host = row["kind"], _host(row)
    if kind == "encode_mit":
        return _operation_control(row)
    if kind in _PLAIN:
        return _PLAIN[kind](_motor(row), host_id=host)
    return _WITH_VALUE[kind](row, host)


def test_every_row_is_used_below():
    kinds = Counter(row["kind"] for row in _all_rows())
    assert sum(kinds.values()) == 886
    assert len(kinds) == 21


def test_commands_encode_byte_for_byte():
    for row in _rows(*_COMMANDS, count=477):
        assert row["expected"] == "ok"
        assert encode_command(_command(row), _model(row)) == _frame(row), row["note"]


def test_commands_decode_to_themselves_on_the_motor():
    for row in _rows(*_COMMANDS[1:], count=277):
        assert decode_command(_frame(row), _motor(row), _model(row)) == _command(row)


def test_a_motor_takes_the_forms_that_other_hosts_send():
    forms = 0
    for row in _rows(*_COMMANDS[1:], count=277):
        if row["alt_data_hex"]:
            data = b"" if row["alt_data_hex"] == "<empty>" else bytes.fromhex(row["alt_data_hex"])
            frame = Frame(int(row["arbitration_id_hex"], 16), data)
            assert decode_command(frame, _motor(row), _model(row)) == _command(row)
            forms += 1
    assert forms > 80


def test_a_motor_reads_operation_control_as_the_reference_would():
    for row in _rows("encode_mit", count=200):
        command = decode_command(_frame(row), _motor(row), _model(row))
        assert isinstance(command, messages.OperationControl)
        for name, column in (
            ("position", "dec_position"),
            ("velocity", "dec_velocity"),
            ("effort", "dec_effort"),
            ("stiffness", "dec_kp"),
            ("damping", "dec_kd"),
        ):
            assert getattr(command, name) == pytest.approx(float(row[column]), abs=1e-9)


def test_values_that_are_not_finite_are_refused():
    for row in _rows("encode_mit_nonfinite", count=15):
        command, model = _operation_control(row), _model(row)
        with pytest.raises(FieldError, match=r"^OperationControl: is .*(nan|inf).*finite"):
            encode_command(command, model)


def test_parameter_values_that_do_not_fit_are_refused():
    for row in _rows("cmd_write_parameter_invalid", count=21):
        with pytest.raises(FieldError, match=r"^WriteParameter\.payload: is "):
            pack_value(ParameterType[row["param_type"].upper()], _number(row["value"]))


def _decoded(row):
    return decode_reply(_frame(row), {_motor(row): _model(row)}, _host(row))


def test_statuses_and_active_reports():
    for row in _rows("decode_status", "decode_active_report", count=220):
        status = _decoded(row)
        assert isinstance(status, messages.Status)
        assert (status.motor_id, status.host_id) == (_motor(row), _host(row))
        assert status.is_report == (row["expected"] == "active_report")
        for name in ("position", "velocity", "effort", "temperature"):
            assert getattr(status, name) == pytest.approx(float(row[f"dec_{name}"]), abs=1e-9)
        assert status.mode == int(row["dec_mode"])
        assert status.faults == int(row["dec_fault_bits"])
        assert "|".join(flag_names(status.faults)) == row["dec_faults"]


def test_statuses_encode_to_the_frames_that_they_came_in():
    full_scale = 0
    for row in _rows("decode_status", "decode_active_report", count=220):
        status = _decoded(row)
        assert isinstance(status, messages.Status)
        frame = encode_reply(status, _model(row))
        assert frame.arbitration_id == _frame(row).arbitration_id
        raw = np.frombuffer(frame.data, ">u2").astype(int)
        expected = np.frombuffer(_frame(row).data, ">u2").astype(int)
        full_scale += int((expected == 65535).sum())
        expected[:3] = np.minimum(expected[:3], 65534)  # 65535 is never sent in this convention
        assert (expected - raw >= 0).all()
        assert (expected - raw <= [1, 1, 1, 0]).all()  # truncation of a decoded value may lose the last step
    assert full_scale > 0


def test_fault_reports():
    for row in _rows("fault_report", count=40):
        report = _decoded(row)
        faults, warnings = int(row["dec_fault_bits"]), int(row["dec_warning_bits"])
        assert isinstance(report, messages.FaultReport)
        assert (report.motor_id, report.faults, report.warnings) == (_motor(row), faults, warnings)
        names, _, warning_names = row["dec_faults"].partition("/")
        assert "|".join(flag_names(report.faults)) == names
        assert "|".join(flag_names(report.warnings)) == warning_names
        assert encode_reply(report, _model(row)) == _frame(row)


def test_parameter_replies():
    outcomes = Counter(row["expected"] for row in _rows("reply_read_parameter", count=44))
    assert outcomes == {"param_reply": 40, "param_reply_failed": 3, "error:bad_dlc": 1}
    for row in _rows("reply_read_parameter", count=44):
        reply = _decoded(row)
        if row["expected"] == "error:bad_dlc":
            assert reply == messages.Malformed(_motor(row), "parameter reply with 7 bytes, expected 8")
            continue
        assert isinstance(reply, messages.ParameterReply)
        assert (reply.motor_id, reply.index) == (_motor(row), int(row["param_id_hex"], 16))
        assert reply.is_success == (row["expected"] == "param_reply")
        assert encode_reply(reply, _model(row)) == _frame(row)
        if not reply.is_success:
            continue
        value = unpack_value(ParameterType[row["param_type"].upper()], reply.payload)
        expected = np.float32(row["value"]) if row["param_type"] == "f32" else int(row["value"])
        assert value == expected or (math.isnan(value) and math.isnan(expected))


def test_device_ids_are_heard_from_every_motor():
    for row in _rows("reply_get_device_id", count=9):
        reply = decode_reply(_frame(row), {}, _HOST)
        assert reply == messages.DeviceId(_motor(row), bytes.fromhex(row["value"]))
        assert encode_reply(reply, _model(row)) == _frame(row)


def _class_of(message):
    match message:
        case messages.Ignored(reason):
            return f"ignore:{reason}"
        case messages.Malformed():
            return "error:bad_dlc" if "bytes, expected" in message.reason else "error"
        case messages.Status(is_report=is_report):
            return "active_report" if is_report else "status"
        case _:
            return type(message).__name__


def test_every_malformed_frame_gets_its_class():
    for row in _rows("malformed", count=57):
        assert _class_of(_decoded(row)) in row["expected"].split("|"), row["note"]


def test_a_motor_ignores_what_is_no_command():
    ignored = 0
    for row in _rows("malformed", count=57):
        message = decode_command(_frame(row), _motor(row), _ANY_MODEL)
        if not row["expected"].startswith("ignore:host_command"):
            assert isinstance(message, messages.Ignored), row["note"]
            ignored += 1
    assert ignored == 48
