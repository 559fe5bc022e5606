import pytest
from waiting import until

from humanoid_sim.hardware.calibration import CalibrationEntry, load_calibration, save_calibration
from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.protocol import FrameType
from humanoid_sim.hardware.tools import calibrate as tool
from humanoid_sim.robots.description import load_robot

_CHANNEL = "virtual:bench-calibrate"
_LITE = load_robot("lite")
_OFFSETS = {"left_elbow_pitch": 0.3, "left_wrist_yaw": -0.2}
_JOINTS = ("--joints", "left_elbow_pitch", "left_wrist_yaw", "left_wrist_roll")


@pytest.fixture(scope="module")
def motors():
    with MockServer(_LITE, [_CHANNEL], homing_offset=_OFFSETS) as motors:
        yield motors


@pytest.fixture
def lead(monkeypatch):
    """Lead joints by hand from stop to stop; the tool's sweep ends afterwards."""

    def begin(motors, robot, *names):
        ends, calls, moved = ["lower", "upper"], [], [0.0]

        def move(mock):
            end = ends.pop(0)
            for joint in map(mock.names.index, names):
                mock.plant.data.qpos[mock.plant.joints.qpos[joint]] = getattr(robot.joints[joint], end)
                mock.plant.jam(joint, True)
            calls.clear()
            moved[0] = mock.time + 0.1

        def is_over():
            calls.append(motors.clock())
            was_read = len(calls) > 4 and motors.clock() > moved[0]
            if was_read and ends:
                motors.call(move)
                return False
            return was_read

        monkeypatch.setattr(tool, "_is_over", is_over)
        monkeypatch.setattr(tool, "_LATE", 20.0)  # a busy machine may be late

    return begin


def test_swept_joints_are_calibrated_and_no_motor_is_written_to(run, table_rows, motors, lead, path, monkeypatch):
    sent, send = [], RobstrideLink.send

    def watched(requests, commands):
        sent.extend(frame.arbitration_id >> 24 for group in commands.values() for frame in group)
        send(requests, commands)

    monkeypatch.setattr(RobstrideLink, "send", watched)
    lead(motors, _LITE, *_OFFSETS)
    old = {
        "left_elbow_pitch": CalibrationEntry(14, -1, 1.0, direction_confirmed=True),
        "left_wrist_roll": CalibrationEntry(16, -1, 0.5),
        "neck_yaw": CalibrationEntry(31, 1, 0.25),
    }
    save_calibration(path, old)
    status, printed, complained = _calibrate(run, path, joints=_JOINTS)
    assert (status, complained) == (0, "")
    entries = load_calibration(path, _LITE).entries
    assert list(entries) == ["left_elbow_pitch", "left_wrist_yaw", "left_wrist_roll", "neck_yaw"]
    for name, offset in _OFFSETS.items():
        assert entries[name].homing_offset == pytest.approx(offset, abs=0.04)
        assert entries[name].direction_confirmed is (name == "left_elbow_pitch")
    assert entries["left_wrist_roll"] == old["left_wrist_roll"]
    assert entries["neck_yaw"] == old["neck_yaw"]
    verdicts = {row[0]: row[-1] for row in table_rows(printed) if row[0].startswith("left")}
    assert verdicts["left_elbow_pitch"] == verdicts["left_wrist_yaw"] == "good"
    assert verdicts["left_wrist_roll"] == "unswept"
    assert f"wrote {path}: 2 joints calibrated, 2 kept\n" in printed
    assert set(sent) == {FrameType.READ_PARAMETER}


def _calibrate(run, path, *words, joints=("--joints", "left_elbow_pitch"), channel=_CHANNEL):
    return run("calibrate", channel, "--output", str(path), *joints, *words)


@pytest.fixture(autouse=True)
def terminal(types):
    types("yes")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "calibration.yaml"


def test_a_flipped_direction_is_warned_of_and_not_written(run, monkeypatch, path):
    monkeypatch.setattr(tool, "_sweep", lambda *_: {3: (-0.01, 2.37)})  # of the elbow
    status, printed, complained = _calibrate(run, path)
    assert status == 1
    assert all(words in complained for words in ("left_elbow_pitch", "direction", "--any-offset"))
    assert f"{path}: not written, no joint was calibrated" in printed
    assert not path.exists()
    assert _calibrate(run, path, "--any-offset")[0] == 0
    assert load_calibration(path, _LITE).entries["left_elbow_pitch"].homing_offset == pytest.approx(-2.358, abs=1e-3)


def test_ctrl_c_writes_nothing(run, motors, path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(tool, "_is_over", interrupt)
    status, _, complained = _calibrate(run, path, joints=())
    assert (status, complained) == (130, "interrupted\n")
    assert not path.exists()


@pytest.mark.parametrize(
    ("fault", "status", "problem"),
    [
        (Fault("silent", ("left_wrist_yaw",)), 3, "left_wrist_yaw (15) does not answer on virtual:bench-fault"),
        (Fault("bus_off", start=0.5), 2, "virtual:bench-fault: down: bus-off"),
    ],
)
def test_a_silent_motor_or_a_channel_that_goes_down_ends_the_sweep(run, path, monkeypatch, fault, status, problem):
    monkeypatch.setattr(tool, "_SILENT", 0.5 if status == 3 else 20.0)
    monkeypatch.setattr(tool, "_is_over", lambda: False)
    with MockServer(_LITE, ["virtual:bench-fault"]) as motors:
        motors.inject(fault)
        ended, _, complained = _calibrate(run, path, joints=(), channel="virtual:bench-fault")
    assert (ended, problem in complained) == (status, True)
    assert not path.exists()


def test_motors_without_questions_are_enabled_limp_for_the_sweep(run, types, path, lead):
    robot, channel, log = load_robot("lite_sito"), "virtual:bench-limp", []
    words = ("calibrate", channel, "--robot", "lite_sito", "--output", str(path), "--joints", "left_wrist_roll")
    with MockServer(robot, [channel], log=lambda _, text: log.append(text)) as motors:
        types("no")
        status, _, complained = run(*words)
        assert (status, complained, log) == (2, "error: not enabled: not confirmed\n", [])
        lead(motors, robot, "left_wrist_roll")
        types("yes")
        status, printed, complained = run(*words)
        until(lambda: "left_wrist_roll: disabled" in log)
    assert status == 0, printed + complained
    assert abs(load_calibration(path, robot).entries["left_wrist_roll"].homing_offset) < 0.1
    assert log == ["left_wrist_roll: enabled", "left_wrist_roll: disabled"]
