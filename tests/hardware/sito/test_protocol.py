"""The golden vectors, `tests/data/sito_vectors.csv`, in both directions, and frames that no vector shows."""

import csv
import math
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.sito.protocol import Command, Enable, Gains, MessageType, Reset, decode, encode
from humanoid_sim.robots.motors import MOTORS

TA50 = MOTORS["TA40-50"]
COUNT = 2.0 * math.pi / 65536.0
with (Path(__file__).parents[2] / "data" / "sito_vectors.csv").open(encoding="utf-8", newline="") as file:
    ROWS = tuple(csv.DictReader(file))
FEEDBACK = {  # by kind: its values, and the bytes that are known
    "feedback_1": (("velocity", "effort"), (2, 3, 6, 7)),
    "feedback_2": (("position",), (4, 5, 6, 7)),
}


def numbers(row, *names):
    return [float(row[name]) for name in names]


def host_message(row):
    device_id = int(row["device_id"])
    match row["kind"]:
        case "command":
            return Command(device_id, *numbers(row, "position", "velocity", "effort"))
        case "gains":
            return Gains(device_id, *numbers(row, "stiffness", "damping"))
        case "enable":
            return Enable(device_id, int(row["feedback_interval_ms"]))
    return Reset(device_id)


def test_a_hosts_messages_are_encoded_bit_for_bit_and_read_back():
    rows = [row for row in ROWS if row["kind"] not in FEEDBACK]
    assert len(rows) == 97
    for row in rows:
        model, message = MOTORS[row["model"]], host_message(row)
        frame = Frame(int(row["can_id"], 16), bytes.fromhex(row["data"]))
        assert encode(message, model) == frame, row
        back = decode(frame, model)
        assert type(back) is type(message)
        for name in message.__struct_fields__:
            resolution = model.effort / 32767 if name == "effort" else COUNT
            expected = getattr(message, name)
            assert getattr(back, name) == pytest.approx(expected, rel=1e-6, abs=0.5 * resolution)


def test_a_motors_messages_are_read_and_encoded_in_their_known_bytes():
    rows = [row for row in ROWS if row["kind"] in FEEDBACK]
    assert len(rows) == 43
    for row in rows:
        names, places = FEEDBACK[row["kind"]]
        data = bytes.fromhex(row["data"])
        found = decode(Frame(int(row["can_id"], 16), data), MOTORS[row["model"]])
        assert [getattr(found, name) for name in names] == pytest.approx(numbers(row, *names), rel=1e-12)
        assert found.device_id == int(row["device_id"])
        known = encode(found, MOTORS[row["model"]]).data
        assert [known[i] for i in places] == [data[i] for i in places]


@pytest.mark.parametrize(
    "message",
    [
        Command(22, 0.0, 3.2, 0.0),
        Command(22, 0.0, 0.0, 151.0),
        Command(22, 2.1e5, 0.0, 0.0),
        Command(22, math.nan, 0.0, 0.0),
        Gains(22, 1e300, 0.0),
        Enable(22, 256),
    ],
)
def test_a_value_that_does_not_fit_is_never_wrapped(message):
    with pytest.raises((struct.error, ValueError, OverflowError)):
        encode(message, TA50)


@given(st.binary(max_size=8), st.integers(0, 255), st.integers(0, 255) | st.sampled_from(MessageType))
def test_no_frame_makes_it_raise(data, device_id, kind):
    found = decode(Frame(0x05060000 | device_id << 8 | kind, data), TA50)
    assert found is None or (found.device_id == device_id and len(data) == 8)
