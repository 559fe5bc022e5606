import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.messages import Mode
from humanoid_sim.play.options import parse_branch
from humanoid_sim.recording.codec import TickEncoder
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.replay import main as replay


@pytest.fixture(scope="module")
def once():
    """The file and the ticks of `recorded`, made by the first test that asks."""
    return {}


@pytest.fixture
def recorded(folder, quick, run, once):
    """A run of the sample policy to 3.6 s, in `run.mcap`; LOCOMOTION begins at 2.7 s."""
    if not once:
        ticks = run("--robot", quick, "--duration", "3.6").ticks
        once["run"] = (folder / "r.mcap").read_bytes(), ticks
        (folder / "r.mcap").unlink()
    content, ticks = once["run"]
    (folder / "run.mcap").write_bytes(content)
    return ticks


def bits(tick):
    """All that a tick took in and decided; its number and how long it took aside."""
    return TickEncoder(14).encode(replace(tick, index=0, duration=0.0, overrun=False))


@pytest.mark.parametrize("seconds", ["0", "1.7", "3.005"])
def test_the_same_policy_goes_on_bit_for_bit(folder, recorded, run, seconds):
    """From ZERO_TORQUE, within STANDBY, and between two steps of the policy; to the end, and in as many ticks."""
    result = run("--branch", f"run.mcap@{seconds}")
    assert result.status == 0
    expected = [tick for tick in recorded if float(tick.input.state.time) > float(seconds) - 0.001]
    assert float(result.ticks[0].input.state.time) == pytest.approx(float(seconds))
    assert len(result.ticks) == len(expected)
    assert [bits(tick) for tick in result.ticks] == [bits(tick) for tick in expected]
    assert replay([str(folder / "r.mcap")]) == 0


def test_other_gains_go_on_from_the_same_state_and_frame(folder, recorded, run):
    (folder / "gains.yaml").write_text("override:\n  joint_stiffness: 30.0\n", encoding="utf-8")
    result = run("--branch", "run.mcap@3.005", "--contract", "gains.yaml")
    assert result.status == 0
    before = next(tick for tick in recorded if float(tick.input.state.time) > 3.004)
    assert np.array_equal(result.ticks[0].input.state.joint_position, before.input.state.joint_position)
    steps = [tick.output.policy_step for tick in result.ticks if tick.output.policy_step is not None]
    old = [tick.output.policy_step for tick in recorded[before.index :] if tick.output.policy_step is not None]
    assert steps[0].frame == old[0].frame
    assert result.ticks[-1].output.control_mode.mode is Mode.DAMPING
    moving = [tick for tick in result.ticks if tick.output.control_mode.mode is Mode.LOCOMOTION]
    assert moving[-1].output.command.stiffness[0] == 30.0
    assert not np.array_equal(moving[-1].input.state.joint_position, recorded[-2].input.state.joint_position)
    assert replay([str(folder / "r.mcap")]) == 0


def test_a_script_takes_the_place_of_recorded_intents(folder, recorded, run):
    result = run("--branch", "run.mcap@2.9", "--script", "hold 0.2; damp; hold 0.2")
    assert result.modes == ["LOCOMOTION", "DAMPING"]
    assert result.ticks[0].output.control_mode.mode is Mode.LOCOMOTION


def test_a_branch_cannot_branch(folder, recorded, run):
    assert run("--branch", "run.mcap@2.9").status == 0
    shutil.move(folder / "r.mcap", folder / "second.mcap")
    result = run("--branch", "second.mcap@3.0")
    assert result.status == 2
    assert "'second.mcap' is a branch itself" in result.err


def test_an_instant_that_was_not_recorded(folder, recorded, run):
    result = run("--branch", "run.mcap@60")
    assert result.status == 2
    assert "60 s is behind the end of 'run.mcap'" in result.err
    result = run("--branch", "run.mcap@-1")
    assert "-1 s is before the recording's begin, 0 s" in result.err
    assert not (folder / "r.mcap").exists()


def test_another_simulation_is_named(folder, recorded, make_robot, run, monkeypatch):
    """The scene has changed since: the first reading that is not the recorded one is named."""
    from humanoid_sim.simulation import plant  # noqa: PLC0415

    step = plant.Plant.step

    def heavier(self, count):
        self.model.opt.gravity[2] = -9.9
        step(self, count)

    monkeypatch.setattr(plant.Plant, "step", heavier)
    result = run("--branch", "run.mcap@2.9")
    assert result.status == 2
    assert "cannot be simulated again: tick 1 (0.005 s): joint_position of left_shoulder_pitch was" in result.err


def test_a_name_may_hold_an_at_sign():
    assert parse_branch("a@b.mcap@2.5") == ("a@b.mcap", 2.5)


@pytest.mark.slow
def test_a_run_on_hardware_goes_on_from_what_was_measured(folder, quick, run):
    script = ("--script", "damp; hold 0.2; load_a; wait; start_locomotion; hold 1; damp; hold 0.2", "--allow-script")
    hardware = ("--hardware", "virtual:lite", "--policy", "lite_tracking", "--yes")
    real = run(*hardware, "--robot", quick, *script, "--duration", "4")
    shutil.move(folder / "r.mcap", folder / "real.mcap")
    check_measured(folder, real.ticks, run)


def test_what_was_measured_is_where_a_branch_of_a_real_run_begins(folder, recorded, run):
    """The recording says that it is of a real robot, so nothing is simulated again."""
    header = open_recording(folder / "run.mcap").header
    settings = json.loads(header.documents["settings"])
    settings["options"]["hardware"] = "can0"
    recorder = McapRecorder(folder / "real.mcap")
    recorder.start(replace(header, documents={**header.documents, "settings": json.dumps(settings)}))
    for tick in recorded:
        recorder.tick(tick)
    recorder.close()
    check_measured(folder, recorded, run)


def check_measured(folder, recorded, run):
    """Branch `real.mcap` in LOCOMOTION."""
    moving = [tick for tick in recorded if tick.output.control_mode.mode is Mode.LOCOMOTION]
    instant = moving[20]
    time = float(instant.input.state.time)
    result = run("--branch", f"real.mcap@{time}")
    assert result.status == 0
    first = result.ticks[0]
    assert np.array_equal(first.input.state.joint_position, instant.input.state.joint_position)
    assert np.array_equal(first.input.state.joint_velocity, instant.input.state.joint_velocity)
    assert float(first.input.state.time) == pytest.approx(time, abs=0.0003)
    assert first.output.control_mode.mode is Mode.LOCOMOTION
    assert "joints as measured on the robot; unknown: contacts, forces from outside" in " ".join(result.out.split())
    frames = [tick.output.policy_step.frame for tick in result.ticks if tick.output.policy_step is not None]
    old = [tick.output.policy_step.frame for tick in moving[20:] if tick.output.policy_step is not None]
    assert frames[0] == old[0]
    assert replay([str(folder / "r.mcap")]) == 0


def one_segment(document):
    document["standby_controller_a"]["segment_durations"] = [0.4]
    document["standby_controller_b"]["segment_durations"] = [0.4]


@pytest.mark.parametrize("drop", ["0.05", "0"])
def test_a_free_standing_robot_began_as_recorded(folder, make_robot, run, drop):
    robot = make_robot("lite_biped", one_segment)
    script = "damp; load_a; wait; start_locomotion; hold 0.3; damp; load_a; wait; start_locomotion; hold 0.2"
    first = run("--robot", robot, "--drop", drop, "--script", script)
    shutil.move(folder / "r.mcap", folder / "run.mcap")
    settings = json.loads(open_recording(folder / "run.mcap").header.documents["settings"])
    assert settings["options"]["drop"] == float(drop)
    begin = next(i for i, tick in enumerate(first.ticks) if tick.output.control_mode.mode is Mode.LOCOMOTION)
    expected = first.ticks[begin + 20 :]
    result = run("--branch", f"run.mcap@{expected[0].input.state.time:g}")
    assert result.status == 0, result.err
    assert expected[0].output.control_mode.mode is Mode.LOCOMOTION
    assert [bits(tick) for tick in result.ticks[: len(expected)]] == [bits(tick) for tick in expected]


def test_remote_without_a_producer_would_let_a_free_robot_fall_and_is_refused(folder, make_robot, run):
    script = ("--script", "damp; hold 0.1; load_a; wait; start_remote; hold 1")
    result = run("--robot", make_robot("lite_biped", one_segment), *script)
    assert "START_REMOTE refused: no remote command within the last 100 ms" in " ".join(result.out.split())
    assert {tick.output.control_mode.mode for tick in result.ticks} == {Mode.DAMPING, Mode.STANDBY}
    assert replay([str(folder / "r.mcap")]) == 0


def test_pushes_of_the_run_come_again_and_others_are_added(folder, make_robot, run):
    script = ("--script", "damp; hold 0.1; load_a; wait; start_locomotion; hold 1")

    robot = make_robot("lite_biped", one_segment)
    first = run("--robot", robot, "--policy", "placeholder", "--push", "0.5,0@0.8", *script)
    assert any("support released" in event.text for event in first.events)
    shutil.move(folder / "r.mcap", folder / "run.mcap")
    same = run("--branch", "run.mcap@0.9")
    assert [tick.input.state.imu_quaternion.tobytes() for tick in same.ticks] == [
        tick.input.state.imu_quaternion.tobytes() for tick in first.ticks[-len(same.ticks) :]
    ]
    pushed = run("--branch", "run.mcap@0.9", "--push", "0,1@0.95")
    before, after = (run.ticks[40].input.state.extern["base_linear_velocity"].value for run in (same, pushed))
    assert after[1] - before[1] > 0.2
    assert "expected at 0.9 s, where the branch begins" in run("--branch", "run.mcap@0.9", "--push", "0,1@0.5").err
