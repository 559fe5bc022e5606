"""The tests' own motor speaks the protocol: the golden vectors, which come from others' programs."""

import csv
import struct
from pathlib import Path

import pytest
from wire_motor import (
    GET_ID,
    OPERATION,
    READ,
    REPORT,
    STATUS,
    WRITE,
    Frame,
    WireMotor,
    fault_frame,
    operation,
    operation_frame,
)

_VECTORS = Path(__file__).parents[1] / "data" / "robstride_vectors.csv"
_ROWS = list(csv.DictReader(_VECTORS.read_text(encoding="utf-8").splitlines()))


def rows(kind, count):
    found = [row for row in _ROWS if row["kind"] == kind]
    assert len(found) == count
    return found


def parts(row):
    number, data = int(row["arbitration_id_hex"], 16), bytes.fromhex(row["data_hex"])
    return number >> 24, number >> 8 & 0xFFFF, number & 0xFF, data


def frame_of(row):
    kind, area, motor_id, data = parts(row)
    return Frame(motor_id, kind, area, data)


def motor_of(row, **fields):
    return WireMotor(int(row["can_id"]), row["model"] or "rs-02", **fields)


def test_operation_control_is_read_and_written():
    for row in rows("encode_mit", 200):
        kind, area, _, data = parts(row)
        assert kind == OPERATION
        values = operation(area, data, row["model"])
        expected = [float(row[f"dec_{name}"]) for name in ("position", "velocity", "effort", "kp", "kd")]
        assert list(values) == pytest.approx(expected, abs=1e-9)
        number, again = operation_frame(int(row["can_id"]), row["model"], values)
        assert abs((number >> 8 & 0xFFFF) - area) <= 1
        for raw, expected in zip(struct.unpack(">HHHH", again), struct.unpack(">HHHH", data), strict=True):
            assert abs(raw - expected) <= 1


@pytest.mark.parametrize(
    ("kind", "count", "sent_as"), [("decode_status", 200, STATUS), ("decode_active_report", 20, REPORT)]
)
def test_a_status_is_written(kind, count, sent_as):
    for row in rows(kind, count):
        motor = motor_of(row, mode=int(row["dec_mode"]), faults=int(row["dec_fault_bits"]))
        motor.position, motor.velocity, motor.effort, motor.temperature = (
            float(row[f"dec_{name}"]) for name in ("position", "velocity", "effort", "temperature")
        )
        expected_kind, area, host, data = parts(row)
        number, found = motor.status(host, sent_as)
        assert (number >> 24, number >> 8 & 0xFFFF, number & 0xFF) == (expected_kind, area, host), row["note"]
        for raw, expected in zip(struct.unpack(">HHHH", found), struct.unpack(">HHHH", data), strict=True):
            assert abs(raw - expected) <= 1 or abs(motor.position) > 12.56, row["note"]


def test_a_fault_report_is_written():
    for row in rows("fault_report", 40):
        _, area, host, data = parts(row)
        number, found = fault_frame(area & 0xFF, int(row["dec_fault_bits"]), int(row["dec_warning_bits"]), host)
        assert (number, found) == (int(row["arbitration_id_hex"], 16), data), row["note"]


def test_commands_are_obeyed_and_answered():
    for row in rows("cmd_enable", 17):
        motor = motor_of(row)
        assert motor.answer(frame_of(row)) is not None
        assert motor.mode == 2
    for row in rows("cmd_clear_fault", 16):
        motor = motor_of(row, mode=2, faults=5)
        motor.answer(frame_of(row))
        assert (motor.mode, motor.faults) == (0, 0)
    for row in rows("cmd_read_version", 17):
        frame = frame_of(row)
        assert frame.is_question
        assert not frame.is_stop
        motor = motor_of(row, mode=2, version=bytes((1, 2, 3, 4)))
        number, data = motor.answer(frame) or (0, b"")
        assert (number >> 24, data[:7], motor.mode) == (STATUS, bytes.fromhex("00C45601020304"), 2)
    for row in rows("cmd_active_report", 33):
        motor = motor_of(row)
        motor.answer(frame_of(row))
        assert motor.reports == (row["value"] == "1")
    assert all(frame_of(row).is_stop for row in rows("cmd_disable", 17))


def test_parameters_are_written_and_read():
    for row in rows("cmd_write_parameter", 79):
        motor, frame = motor_of(row), frame_of(row)
        assert (frame.kind, frame.index) == (WRITE, int(row["param_id_hex"], 16))
        motor.answer(frame)
        assert motor.parameters[frame.index] == frame.data[4:]
    for row in rows("reply_read_parameter", 44):
        _, _, host, data = parts(row)
        index = int(row["param_id_hex"], 16)
        if row["expected"] != "param_reply" or index == 0x7019:
            continue
        motor = motor_of(row, parameters={index: data[4:]})
        reply = motor.answer(Frame(motor.motor_id, READ, host, data[:4] + bytes(4)))
        assert reply == (int(row["arbitration_id_hex"], 16), data), row["note"]


def test_it_says_who_it_is():
    for row in rows("reply_get_device_id", 9):
        motor = motor_of(row, uid=bytes.fromhex(row["data_hex"]))
        reply = motor.answer(Frame(motor.motor_id, GET_ID, 0xFD, bytes(8)))
        assert reply == (int(row["arbitration_id_hex"], 16), bytes.fromhex(row["data_hex"]))
