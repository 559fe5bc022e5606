"""Every row of the golden vectors, `tests/data/sito_vectors.csv`, and what no vector shows."""

import csv
import math
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.motor_link import MotorGroup
from humanoid_sim.hardware.sito import codec
from humanoid_sim.hardware.sito.codec import (
    SitoEncoder,
)
from humanoid_sim.robots.motors import MOTORS

_VECTORS = Path(__file__).parents[2] / "data" / "sito_vectors.csv"
TA50, TA100 = MOTORS["TA40-50"], MOTORS["TA40-100"]
COUNT = 2.0 * math.pi / 65536.0


@cache
def rows():
    with _VECTORS.open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


def frame(row):
    return Frame(int(row["can_id"], 16), bytes.fromhex(row["data"]))


def told(row):
    """What a row's host says."""
    device_id = int(row["device_id"])
    match row["kind"]:
        case "command":
            return codec.Command(device_id, *(float(row[name]) for name in ("position", "velocity", "effort")))
        case "gains":
            return codec.Gains(device_id, float(row["stiffness"]), float(row["damping"]))
        case "enable":
            interval = int(row["feedback_interval_ms"])
            return codec.SelectMode(device_id, codec.Mode.MIT, (interval, interval, 0))
        case _:
            assert row["kind"] == "disable"
            return codec.Reset(device_id)


def test_all_kinds_are_here():
    assert Counter(row["kind"] for row in rows()) == {
        "command": 22, "gains": 26, "enable": 25, "disable": 24, "feedback_1": 27, "feedback_2": 16,
    }  # fmt: skip


def test_what_a_host_says_is_encoded_bit_for_bit_and_read_back():
    checked = 0
    for row in rows():
        if row["kind"].startswith("feedback"):
            continue
        model, message = MOTORS[row["model"]], told(row)
        assert codec.encode(message, model) == frame(row), row
        back = codec.decode(frame(row), model)
        assert type(back) is type(message)
        match back, message:
            case codec.Command(), codec.Command():
                assert back.position == pytest.approx(message.position, abs=0.5 * COUNT)
                assert back.velocity == pytest.approx(message.velocity, abs=0.5 * COUNT)
                assert back.effort == pytest.approx(message.effort, abs=0.5 * model.effort / 32767)
            case codec.Gains(), codec.Gains():
                assert (back.stiffness, back.damping) == pytest.approx((message.stiffness, message.damping), rel=1e-6)
            case _:
                assert back == message
        checked += 1
    assert checked == 97


def test_what_a_motor_says_is_read():
    checked = 0
    for row in rows():
        found = codec.decode(frame(row), MOTORS[row["model"]])
        if row["kind"] == "feedback_1":
            assert isinstance(found, codec.Feedback)
            assert found.velocity == pytest.approx(float(row["velocity"]), rel=1e-12)
            assert found.effort == pytest.approx(float(row["effort"]), rel=1e-12)
        elif row["kind"] == "feedback_2":
            assert isinstance(found, codec.PositionFeedback)
            assert found.position == pytest.approx(float(row["position"]), rel=1e-12)
        else:
            continue
        assert found.device_id == int(row["device_id"])
        known = codec.encode(found, MOTORS[row["model"]])  # the bytes whose meaning is known
        places = (2, 3, 6, 7) if row["kind"] == "feedback_1" else (4, 5, 6, 7)
        assert [known.data[i] for i in places] == [frame(row).data[i] for i in places]
        checked += 1
    assert checked == 43


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (codec.Command(22, 0.0, 3.2, 0.0), r"^Command\.velocity: is 3\.2, expected within ±3\.14"),
        (codec.Command(22, 0.0, 0.0, 151.0), r"^Command\.effort: is 151\.0, expected within ±150\.401$"),
        (codec.Command(22, 2.1e5, 0.0, 0.0), r"^Command\.position: is 210000\.0, expected within ±205887$"),
        (codec.Command(22, math.nan, 0.0, 0.0), r"^Command\.position: is nan, expected within"),
        (codec.Command(22, math.inf, 0.0, 0.0), r"^Command\.position: is inf, expected within"),
        (codec.Gains(22, -1.0, 0.0), r"^Gains\.stiffness: is -1\.0, expected a finite number >= 0$"),
        (codec.Gains(22, 0.0, math.nan), r"^Gains\.damping: is nan, expected a finite number >= 0$"),
        (codec.Gains(22, 1e300, 0.0), r"^Gains: are 1e\+300 and 0, beyond a float32$"),
        (codec.Reset(0), r"^Reset\.device_id: is 0, expected 1 to 255$"),
        (codec.Reset(256), r"^Reset\.device_id: is 256, expected 1 to 255$"),
        (codec.SelectMode(22, codec.Mode.MIT, (256, 0, 0)), r"^SelectMode\.intervals: is 256, expected 0 to 255$"),
    ],
)
def test_what_does_not_fit_is_refused_and_never_wrapped(message, text):
    with pytest.raises(FieldError, match=text):
        codec.encode(message, TA50)


@given(st.binary(max_size=8), st.integers(0, 255), st.integers(0, 255))
def test_no_frame_makes_it_raise(data, device_id, kind):
    found = codec.decode(Frame(0x05060000 | device_id << 8 | kind, data), TA50)
    if kind in tuple(codec.MessageType) and kind not in {codec.MessageType.FEEDBACK_0, codec.MessageType.FEEDBACK_3}:
        assert found.device_id == device_id
        assert isinstance(found, codec.Malformed) or len(data) == 8
    else:
        assert found is None


MODEL = MOTORS["TA40-50"]
COMMAND, GAINS = 0, 1


def group(count=2):
    ids = tuple(range(22, 22 + count))
    return MotorGroup(tuple(map(str, ids)), (0,) * count, ids, (MODEL,) * count, (0.0,) * count, (0.0,) * count)


def values(stiffness, damping=1.0, count=2, position=0.0):
    return np.tile(np.array([[position], [0.0], [0.0], [stiffness], [damping]]), (1, count))


def kinds(encoder, what, motor=0):
    return [kind for i, kind, _ in encoder.encode(what) if i == motor]


def test_stiffer_gains_go_after_the_command_and_softer_ones_before():
    encoder = SitoEncoder(group())
    assert kinds(encoder, values(20.0)) == [COMMAND, GAINS], "from the zero gains of enabling"
    assert kinds(encoder, values(50.0)) == [COMMAND, GAINS]
    assert kinds(encoder, values(0.0)) == [GAINS, COMMAND]


def test_gains_that_changed_go_three_times_and_then_to_one_motor_a_tick():
    encoder = SitoEncoder(group(4))
    ticks = [encoder.encode(values(20.0, count=4)) for _ in range(12)]
    counts = [sum(kind == GAINS for _, kind, _ in tick) for tick in ticks]
    assert counts == [4, 4, 4, 1, 1, 1, 1, 1, 1, 1, 1, 1]
    refreshed = [motor for tick in ticks[3:] for motor, kind, _ in tick if kind == GAINS]
    assert sorted(set(refreshed)) == [0, 1, 2, 3]
    assert all(sum(kind == COMMAND for _, kind, _ in tick) == 4 for tick in ticks)


def test_what_makes_a_motor_soft_goes_first_in_every_tick():
    encoder = SitoEncoder(group(4))
    encoder.encode(values(20.0, count=4))
    for _ in range(10):
        frames = encoder.encode(values(0.0, 2.0, count=4))
        assert [(motor, kind) for motor, kind, _ in frames] == [(i, k) for i in range(4) for k in (GAINS, COMMAND)]
