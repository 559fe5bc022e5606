import io
import time
from types import SimpleNamespace

import pytest
import yaml

from humanoid_sim.assets import asset_path
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.robstride.requests import RobstrideLink
from humanoid_sim.hardware.tools import enabled_motor
from humanoid_sim.hardware.tools import identify as tool
from humanoid_sim.hardware.tools.bench import motor_bench, read_value, write_value
from humanoid_sim.robots.description import load_robot

_CHANNEL = "virtual:bench-tools"
_WRIST = ("identify", _CHANNEL, "left_wrist_yaw", "--yes")


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(tool, "_RAMP", 0.12)
    monkeypatch.setattr(tool, "_HOLD", 0.05)
    monkeypatch.setattr(enabled_motor, "CAN_TIMEOUT", 2.0)  # a busy machine may stand still for longer than 0.1 s


def _is_stopped_as_before(motor_id):
    with motor_bench(_CHANNEL, motor_id, 0xFD) as channels:
        write_value(channels, PARAMETERS["zero_sta"], 0)
        sample = channels.table.slots[0].sample
        return read_value(channels, PARAMETERS["canTimeout"]) == 0 and sample.status.mode.name == "RESET"


def test_the_joint_moves_in_its_positive_direction_and_back(run, lite_motors):
    status, printed, complained = run(*_WRIST)
    assert (status, complained) == (0, "")
    assert "motor 15 on virtual:bench-tools will move the joint by +0.15 rad" in printed
    assert "with direction +1 that is +0.1" in printed
    assert _is_stopped_as_before(15)


def test_a_motor_that_turns_the_other_way_than_its_joint(run, lite_motors):
    before = lite_motors.truth.joint_position[5]
    status, printed, _ = run("identify", _CHANNEL, "left_wrist_roll", "--yes", "--angle", "0.2")
    assert status == 0
    assert "motor 16 moved by -0." in printed
    assert "with direction -1 that is +0." in printed
    assert abs(lite_motors.truth.joint_position[5] - before) < 0.1


def test_a_joint_that_is_wired_to_another_motor_is_told(run, lite_motors, tmp_path):
    """With the wrists' ids exchanged in the description, the roll's motor obeys the yaw's name."""
    document = yaml.safe_load(asset_path("robots", "lite.yaml").read_text(encoding="utf-8"))
    document["mjcf"] = str(asset_path("mjcf", "lite.xml"))
    document["joints"][4]["motor"]["can_id"], document["joints"][5]["motor"]["can_id"] = 16, 15
    path = tmp_path / "crossed.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    before = lite_motors.truth.joint_position.copy()
    positions = []
    told = RobstrideLink.poll_values

    def look(*arguments):
        positions.append(lite_motors.truth.joint_position.copy())
        return told(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RobstrideLink, "poll_values", look)
        run("identify", _CHANNEL, "left_wrist_yaw", "--yes", "--robot", str(path))
    there = positions[0] - before
    assert abs(there[5]) > 0.05  # the roll moved
    assert abs(there[4]) < 0.05


def test_a_joint_that_does_not_follow(run, lite_motors):
    status, _, complained = run(*_WRIST, "--torque", "0.02")  # less than the joint's friction
    assert status == 1
    assert complained == "warning: left_wrist_yaw did not follow: raise --torque, or hold the arm's weight\n"


def test_ctrl_c_in_the_middle_leaves_the_motor_stopped(run, lite_motors, monkeypatch):
    calls = []

    def interrupted(seconds):
        calls.append(seconds)
        if len(calls) == 5:
            raise KeyboardInterrupt
        time.sleep(seconds)

    monkeypatch.setattr(tool, "time", SimpleNamespace(monotonic=time.monotonic, sleep=interrupted))
    status, _, complained = run(*_WRIST)
    assert (status, complained) == (130, "interrupted\n")
    assert _is_stopped_as_before(15)


@pytest.mark.parametrize(("answer", "expected"), [("yes\n", 0), ("y\n", 2)])
def test_leave_is_asked_for_on_a_terminal(run, lite_motors, monkeypatch, answer, expected):
    terminal = io.StringIO(answer)
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", terminal)
    assert run(*_WRIST[:-1])[0] == expected


def test_firmware_that_scales_gains_is_refused(run):
    channel = "virtual:bench-identify"
    with VirtualMotors(load_robot("lite"), [channel], settings=EmulationSettings(firmware={"rs-02": "0.2.3.5"})):
        status, _, complained = run("identify", channel, "left_shoulder_pitch", "--yes")
    assert status == 2
    assert complained == (
        "error: left_shoulder_pitch: its firmware 0.2.3.5 multiplies K_p and K_d by 1.4167: update it\n"
    )
