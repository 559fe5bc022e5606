"""The bench tools on a robot with motors of two families: what cannot be asked is listened for, or enabled limp."""

import re
import threading

import pytest

from humanoid_sim.hardware.bus.frame import message_of
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.sito.protocol import Mode, SelectMode, encode
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.session.realtime import punctual_threads

pytestmark = pytest.mark.soak

ROBOT = load_robot("lite_sito")
CHANNEL = "virtual:bench-sito"
ON = ("--robot", "lite_sito")


@pytest.fixture(scope="module")
def told():
    return []


@pytest.fixture(scope="module")
def motors(told):
    with punctual_threads(behind=10):
        motors = MockServer(ROBOT, [CHANNEL], log=lambda _, text: told.append(text))
    with motors:
        yield motors


def test_discover_and_ping_only_listen(motors, told, run):
    status, printed, _ = run("discover", CHANNEL, *ON, "--wait", "0.005")
    assert status == 0
    assert "not heard: left_wrist_roll (motor 16 on virtual:bench-sito), left_wrist_pitch (motor 17 on " in printed
    assert "that proves nothing: the Sito protocol has no question, so a motor that is not enabled stays " in printed
    status, _, complained = run("ping", CHANNEL, "16", "--family", "sito")
    assert status == 3
    assert complained.startswith("error: Sito motor 16 sends no feedback on virtual:bench-sito within 1 s: the Sito")
    assert told == [], "nothing was enabled"
    with motors.open_bus(motors.addresses[0]) as bus:
        bus.send(message_of(encode(SelectMode(16, Mode.MIT, (20, 20, 0)), MOTORS["TA40-50"])))
    status, printed, _ = run("discover", CHANNEL, *ON, "--wait", "0.005")
    assert "Sito motor 16 on virtual:bench-sito (left_wrist_roll) sends feedback, so it is enabled: " in printed
    status, printed, _ = run("ping", CHANNEL, "16", "--family", "sito")
    assert status == 0
    assert "Nothing was sent" in printed
    assert told == ["left_wrist_roll: enabled"]


def test_identify_asks_for_leave_twice_over_and_bounds_by_the_position(motors, told, run):
    words = ("identify", CHANNEL, "left_wrist_roll", *ON, "--angle", "0.1", "--yes")
    status, _, complained = run(*words)
    assert (status, complained) == (
        2,
        "error: left_wrist_roll: its motor executes its last command for ever when this program dies, for no timeout "
        "of its own is known; --allow-no-timeout accepts that\n",
    )
    told.clear()
    status, printed, _ = run(*words, "--allow-no-timeout")
    assert status == 0, printed
    moved = float(re.findall(r"motor 16 moved by ([+-]\d\.\d+) rad", printed)[0])
    assert -0.13 < moved < -0.05, "direction -1"
    assert [text for text in told if text.endswith("enabled") and "left_wrist_roll" not in text] == []
    assert told[-1] == "left_wrist_roll: disabled"


def test_calibrate_enables_them_limp_for_the_sweep(motors, told, run, tmp_path):
    path = tmp_path / "calibration.yaml"
    words = ("calibrate", CHANNEL, *ON, "--output", str(path), "--joints", "left_wrist_roll", "--duration", "3")
    status, _, complained = run(*words)
    assert (status, complained) == (2, "error: --yes: is needed where standard input is not a terminal\n")
    told.clear()
    joint = ROBOT.joints[5]
    motors.move_by_hand({joint.name: joint.upper + 0.05})
    timer = threading.Timer(1.8, lambda: motors.move_by_hand({joint.name: joint.lower - 0.05}))
    timer.start()
    status, printed, complained = run(*words, "--yes")
    timer.join()
    motors.move_by_hand(None)
    assert status == 0, printed + complained
    assert abs(load_calibration(path, ROBOT).entries["left_wrist_roll"].homing_offset) < 0.1
    assert told == ["left_wrist_roll: enabled", "left_wrist_roll: disabled"]
