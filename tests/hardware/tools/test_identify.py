"""`hardware identify` on mock motors: what it moves, what it stores, and how it ends."""

import time
from types import SimpleNamespace

import pytest
from waiting import until

from humanoid_sim.hardware.calibration import CalibrationEntry, load_calibration, save_calibration
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.tools import identify as tool
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
CHANNEL = "virtual:bench-identify"
WRIST = ("identify", CHANNEL, "left_wrist_yaw", "--torque", "3")
DIRECTION = LITE.joints[4].motor.direction


@pytest.fixture
def log():
    return []


@pytest.fixture
def motors(log):
    with MockServer(LITE, [CHANNEL], log=lambda _, text: log.append(text)) as motors:
        yield motors


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    monkeypatch.setattr(tool, "_RAMP", 0.3)
    monkeypatch.setattr(tool, "_HOLD", 0.2)
    monkeypatch.setattr(tool, "_PATIENCE", 20.0)
    monkeypatch.setattr(tool, "CAN_TIMEOUT", 2.0)  # a busy machine may stand still for longer than 0.1 s
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("before", "answer", "stored"),
    [
        (None, "yes", CalibrationEntry(15, DIRECTION, None, True)),
        (CalibrationEntry(15, DIRECTION, 0.5), "yes", CalibrationEntry(15, DIRECTION, 0.5, True)),
        (CalibrationEntry(15, -DIRECTION, 0.5), "yes", CalibrationEntry(15, DIRECTION, None, True)),
        (CalibrationEntry(15, DIRECTION, 0.5, True), "no", CalibrationEntry(15, DIRECTION, 0.5, False)),
    ],
    ids=["new", "calibrated", "calibrated with another direction", "confirmed before and denied"],
)
def test_the_answer_is_stored_and_the_motor_is_left_disabled(run, types, motors, log, before, answer, stored):
    if before is not None:
        save_calibration("calibration.yaml", {"left_wrist_yaw": before})
    types("yes", answer)
    status, printed, complained = run(*WRIST)
    assert (status, "direction in the robot file" in complained) == ((0, False) if answer == "yes" else (1, True))
    assert f"with direction {DIRECTION:+d}" in printed
    assert load_calibration("calibration.yaml", LITE).entries == {"left_wrist_yaw": stored}
    assert [text for text in log if "abled" in text] == ["left_wrist_yaw: enabled", "left_wrist_yaw: disabled"]


def test_nothing_is_stored_where_nobody_is_asked(run, motors, tmp_path):
    assert run(*WRIST, "--yes")[0] == 0
    assert list(tmp_path.iterdir()) == []


def test_nothing_moves_without_a_yes(run, types, motors, log):
    types("y")
    assert run(*WRIST)[0] == 2
    assert not any("enabled" in text for text in log)


def test_ctrl_c_in_the_middle_leaves_the_motor_stopped(run, motors, log, monkeypatch):
    calls = []

    def interrupted(seconds):
        calls.append(seconds)
        if len(calls) == 5:
            raise KeyboardInterrupt
        time.sleep(seconds)

    monkeypatch.setattr(tool, "time", SimpleNamespace(monotonic=motors.clock, sleep=interrupted))
    assert run(*WRIST, "--yes")[0] == 130
    assert [text for text in log if "abled" in text] == ["left_wrist_yaw: enabled", "left_wrist_yaw: disabled"]


def test_a_motor_without_a_timeout_is_moved_with_leave_only(run):
    log, channel = [], "virtual:bench-identify-sito"
    words = ("identify", channel, "left_wrist_roll", "--robot", "lite_sito", "--angle", "0.1", "--yes")
    with MockServer(load_robot("lite_sito"), [channel], log=lambda _, text: log.append(text)):
        status, _, complained = run(*words)
        assert (status, "--allow-no-timeout" in complained, log) == (2, True, [])
        status, printed, complained = run(*words, "--allow-no-timeout")
        until(lambda: "left_wrist_roll: disabled" in log)  # motors on a busy machine are late
    assert status == 0, printed + complained
    assert [text for text in log if "abled" in text] == ["left_wrist_roll: enabled", "left_wrist_roll: disabled"]
