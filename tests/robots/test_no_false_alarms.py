"""No guard trips on a healthy robot: sample motions, published policies that walk, are pushed, and fall."""

from contextlib import contextmanager
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from published import HOLOSOMA_REST, POLICIES, needs_policies

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.regress import episodes
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.suite import load_suite
from humanoid_sim.robots.description import with_contract_physics
from humanoid_sim.robots.guards import guards_of
from tools.studies.guard_runs import limited

G1 = "models/unitree_g1/scene.xml"
LITE_LEGS = "models/berkeley_humanoid_lite_biped/scene.xml"
UNITREE = "unitree_g1_velocity_v0/exported/policy.onnx"
HOLOSOMA = "holosoma_g1_loco/ppo_g1_29dof.onnx"
BERKELEY = "berkeley_humanoid_lite_biped_50hz/checkpoints/policy_biped_50hz.onnx"


@contextmanager
def watched(monkeypatch, guards):
    """What guards say in rollouts of `regress`, and the largest share of its time that the following guard has seen."""
    alarms = []
    shares = [0.0]

    class Watched(ClosedLoop):
        def __init__(self, *arguments):
            super().__init__(*arguments, guards=guards)

        def act(self, action, *, where, **rest):
            command = super().act(action, where=where, **rest)
            alarms.extend(self.alarm(int(i)) for i in np.flatnonzero(self.tripped & where))
            if self._watched is not None:
                shares.append(float(self._watched.held[where][:, 0].max(initial=0.0)) / guards.following_time)
            return command

    with monkeypatch.context() as patch:
        patch.setattr(episodes, "ClosedLoop", Watched)
        yield alarms, shares


def case_of(suite, policy, name, robot=None, contract=None):
    read, folder = load_suite(suite)
    prepared = prepare_suite(read, folder, None if robot is None else str(robot))
    return next(case for case in prepare_policy(prepared, policy, contract).cases if case.case.name == name)


@pytest.mark.soak
def test_no_alarm_in_a_sample_motion(monkeypatch):
    case = case_of("lite_tracking", SAMPLE_POLICY, "drum")
    guards = guards_of(case.scenario.description)
    assert guards is not None
    with watched(monkeypatch, guards) as (alarms, shares):
        done = episodes.run_episodes(case, range(3), case.suite.disturbance, threads=1)
    assert not any(episode.failure for episode in done)
    assert alarms == []
    assert max(shares) <= 0.5, "with room to spare"


@pytest.mark.soak
@needs_policies
@pytest.mark.parametrize(
    ("policy", "robot", "name", "push", "falls"),
    [
        (UNITREE, G1, "forward", 0.6, False),
        (UNITREE, G1, "forward", 1.5, True),
        (HOLOSOMA, G1, "turn", 0.2, False),
        (HOLOSOMA, G1, "forward", 1.5, True),
        (BERKELEY, LITE_LEGS, "forward", 0.2, False),
        (BERKELEY, LITE_LEGS, "sideways", 0.2, True),
    ],
)
def test_no_alarm_in_walking_pushes_and_falls(policy, robot, name, push, falls, tmp_path, monkeypatch):
    """A fall ends an episode where the robot counts as fallen: up to there no guard may speak."""
    contract = None
    if policy is HOLOSOMA:
        contract = tmp_path / "contract.yaml"
        contract.write_text(HOLOSOMA_REST, encoding="utf-8")
    case = case_of("velocity", POLICIES / policy, name, POLICIES / robot, contract)
    guards = guards_of(with_contract_physics(limited(case.description), case.checkpoint.contract))
    assert np.isfinite(guards.following_effort).all()
    assert case.suite.pushes is not None
    interval = 3.0 if push <= 0.2 else 1.0
    pushes = msgspec.structs.replace(case.suite.pushes, speed=push, interval=interval)
    with watched(monkeypatch, guards) as (alarms, shares):
        done = episodes.run_episodes(case, range(6), replace(case.suite.disturbance, pushes=pushes), threads=2)
    assert any(episode.kind == "lost" for episode in done) is falls
    assert alarms == []
    assert max(shares) <= 0.75, "with room to spare"
