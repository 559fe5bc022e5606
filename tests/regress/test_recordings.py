"""Failing episodes as recordings that repeat bit for bit."""

import json

import numpy as np
from msgspec.structs import replace
from policies import SAMPLE, failing_copy, swapped_copy
from regress_runs import episode, standing_policy, yaml_suite

from humanoid_sim.messages import Mode
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.repeat import repeat_run
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.recordings import choose_failures, record_episode
from humanoid_sim.regress.suite import Case, Pushes, Suite, Tolerance, load_suite
from humanoid_sim.replay import main as replay
from humanoid_sim.stack import rebuild_supervisor


def make(folder, policy, case):
    suite, where = load_suite(str(yaml_suite(folder)))
    return prepare_policy(prepare_suite(replace(suite, cases=(case,)), where), policy).cases[0]


def check(path, case, seed):
    """Record an episode, repeat the recording, compare it with the episode; returns the modes that it passes."""
    steps = []
    (failed,) = run_episodes(case, [seed], case.suite.disturbance, watch=steps)
    assert failed.failure
    record_episode(path, case, failed, case.suite.disturbance)
    recording = open_recording(path)
    records = list(recording.ticks())
    assert recording.is_complete
    assert repeat_run(open_recording(path), rebuild_supervisor).is_identical
    ran = [record for record in records if record.output.policy_step is not None]
    inferred = [step for step in steps if step.action is not None]
    assert len(ran) == len(inferred)
    for record, step in zip(ran, inferred, strict=True):
        assert record.output.policy_step.action.tobytes() == step.action[0].tobytes()
        assert record.input.state.joint_position.tobytes() == step.state.joint_position[0].tobytes()
        assert record.qpos.tobytes() == step.qpos[0].tobytes()
    assert list(path.parent.glob(".*")) == []
    settings = json.loads(recording.header.documents["settings"])
    assert settings["regress"] == {
        "suite": case.suite.name,
        "case": case.case.name,
        "command": None if case.case.command is None else list(case.case.command),
        "seed": seed,
        "failure": failed.failure,
    }
    return [record.output.control_mode.mode for record in records]


def test_an_arm_that_strays(tmp_path, capsys):
    policy = swapped_copy(SAMPLE, tmp_path / "swapped.onnx", 0, 1)
    case = make(tmp_path, policy, Case(name="reach", motion="reach", duration=3.0))
    modes = check(tmp_path / "lost.mcap", case, 1)
    assert modes[:4] == [Mode.DAMPING, Mode.STANDBY, Mode.STANDBY, Mode.LOCOMOTION]
    assert modes[-2:] == [Mode.LOCOMOTION, Mode.DAMPING]
    # The same network on the recorded observations gives the recorded actions: what was batched is what is deployed.
    assert replay(["--infer", str(tmp_path / "lost.mcap")]) == 0
    assert "actions, bit for bit identical" in capsys.readouterr().out


def test_an_action_that_is_refused_at_once(tmp_path):
    policy = failing_copy(SAMPLE, tmp_path / "nan.onnx")
    case = make(tmp_path, policy, Case(name="wave", motion="wave", duration=0.4))
    modes = check(tmp_path / "fault.mcap", case, 0)
    assert modes == [Mode.DAMPING, Mode.STANDBY, Mode.STANDBY, Mode.DAMPING]


def test_a_robot_that_falls(tmp_path):
    suite = Suite(
        name="standing",
        task="velocity",
        robot="lite_biped",
        cases=(Case(name="stand", command=(0.2, 0.0, 0.0), duration=2.0),),
        seeds=2,
        tolerances={"falls": Tolerance()},
        pushes=Pushes(speed=3.0, interval=0.4),
        randomisation={"joint_position_noise": 0.01},
    )
    policy = standing_policy(tmp_path / "standing.onnx")
    (case,) = prepare_policy(prepare_suite(suite, tmp_path), policy).cases
    assert check(tmp_path / "fall.mcap", case, 0)[-1] is Mode.DAMPING
    header = open_recording(tmp_path / "fall.mcap").header
    assert json.loads(header.documents["settings"])["regress"]["command"] == [0.2, 0.0, 0.0]
    assert np.isclose(header.control_period, 0.02)


def test_the_first_failure_of_each_case_comes_first():
    failures = [("a", 0), ("a", 1), ("a", 2), ("b", 5), ("c", 7), ("c", 8)]
    episodes = [episode("a", 9, {}), *(episode(case, seed, {}, "fell") for case, seed in failures)]
    chosen = [(e.case, e.seed) for e in choose_failures(episodes, 4)]
    assert chosen == [("a", 0), ("b", 5), ("c", 7), ("a", 1)]
