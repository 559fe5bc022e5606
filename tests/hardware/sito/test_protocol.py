"""The golden vectors, `tests/data/sito_vectors.csv`, in both directions, and frames that no vector shows."""

import csv
import math
import struct
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.sito import protocol
from humanoid_sim.robots.motors import MOTORS

TA50 = MOTORS["TA40-50"]
COUNT = 2.0 * math.pi / 65536.0
with (Path(__file__).parents[2] / "data" / "sito_vectors.csv").open(encoding="utf-8", newline="") as file:
    ROWS = tuple(csv.DictReader(file))


def frame(row):
    return Frame(int(row["can_id"], 16), bytes.fromhex(row["data"]))


def host_message(row):
    device_id = int(row["device_id"])
    match row["kind"]:
        case "command":
            return protocol.Command(device_id, *(float(row[name]) for name in ("position", "velocity", "effort")))
        case "gains":
            return protocol.Gains(device_id, float(row["stiffness"]), float(row["damping"]))
        case "enable":
            interval = int(row["feedback_interval_ms"])
            return protocol.SelectMode(device_id, protocol.Mode.MIT, (interval, interval, 0))
        case _:
            return protocol.Reset(device_id)


def test_the_vectors_have_all_kinds():
    assert Counter(row["kind"] for row in ROWS) == {
        "command": 22, "gains": 26, "enable": 25, "disable": 24, "feedback_1": 27, "feedback_2": 16,
    }  # fmt: skip


def test_a_hosts_messages_are_encoded_bit_for_bit_and_read_back():
    for row in ROWS:
        if row["kind"].startswith("feedback"):
            continue
        model, message = MOTORS[row["model"]], host_message(row)
        assert protocol.encode(message, model) == frame(row), row
        back = protocol.decode(frame(row), model)
        if isinstance(message, protocol.Command):
            assert back.position == pytest.approx(message.position, abs=0.5 * COUNT)
            assert back.velocity == pytest.approx(message.velocity, abs=0.5 * COUNT)
            assert back.effort == pytest.approx(message.effort, abs=0.5 * model.effort / 32767)
        elif isinstance(message, protocol.Gains):
            assert (back.stiffness, back.damping) == pytest.approx((message.stiffness, message.damping), rel=1e-6)
        else:
            assert back == message


def test_a_motors_messages_are_read_and_encoded_in_their_known_bytes():
    for row in ROWS:
        if not row["kind"].startswith("feedback"):
            continue
        found = protocol.decode(frame(row), MOTORS[row["model"]])
        if row["kind"] == "feedback_1":
            assert (found.velocity, found.effort) == pytest.approx(
                (float(row["velocity"]), float(row["effort"])), rel=1e-12
            )
            places = (2, 3, 6, 7)
        else:
            assert found.position == pytest.approx(float(row["position"]), rel=1e-12)
            places = (4, 5, 6, 7)
        assert found.device_id == int(row["device_id"])
        known = protocol.encode(found, MOTORS[row["model"]])
        assert [known.data[i] for i in places] == [frame(row).data[i] for i in places]


@pytest.mark.parametrize(
    "message",
    [
        protocol.Command(22, 0.0, 3.2, 0.0),
        protocol.Command(22, 0.0, 0.0, 151.0),
        protocol.Command(22, 2.1e5, 0.0, 0.0),
        protocol.Command(22, math.nan, 0.0, 0.0),
        protocol.Command(22, math.inf, 0.0, 0.0),
        protocol.Gains(22, 1e300, 0.0),
        protocol.SelectMode(22, protocol.Mode.MIT, (256, 0, 0)),
    ],
)
def test_a_value_that_does_not_fit_is_never_wrapped(message):
    with pytest.raises((struct.error, ValueError, OverflowError)):
        protocol.encode(message, TA50)


@given(st.binary(max_size=8), st.integers(0, 255), st.integers(0, 255))
def test_no_frame_makes_it_raise(data, device_id, kind):
    found = protocol.decode(Frame(0x05060000 | device_id << 8 | kind, data), TA50)
    unknown = {protocol.MessageType.FEEDBACK_0, protocol.MessageType.FEEDBACK_3}
    if kind in set(protocol.MessageType) - unknown:
        assert found.device_id == device_id
        assert isinstance(found, protocol.Malformed) or len(data) == 8
    else:
        assert found is None
