"""No guard trips on a healthy robot: sample motions, and legs that walk, are pushed, and fall."""

from contextlib import contextmanager
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from humanoid_sim.assets import SAMPLE_POLICY, WALKING_POLICY
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.regress import episodes
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.suite import load_suite
from humanoid_sim.robots.guards import guards_of


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


def case_of(suite, policy, name, robot=None):
    prepared = prepare_suite(*load_suite(suite), robot)
    return next(case for case in prepare_policy(prepared, policy).cases if case.case.name == name)


@pytest.mark.soak
def test_no_alarm_in_a_sample_motion(monkeypatch):
    case = case_of("lite_tracking", SAMPLE_POLICY, "drum")
    guards = guards_of(case.scenario.description)
    assert guards is not None
    with watched(monkeypatch, guards) as (alarms, shares):
        done = episodes.run_episodes(case, range(3), threads=1)
    assert not any(episode.failure for episode in done)
    assert alarms == []
    assert max(shares) <= 0.5, "with room to spare"


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "push", "falls"),
    [("forward", 0.2, False), ("turn", 0.2, False), ("forward", 1.5, True)],
)
def test_no_alarm_in_walking_pushes_and_falls(name, push, falls, monkeypatch):
    """A fall ends an episode where the robot counts as fallen: up to there no guard may speak."""
    case = case_of("velocity", WALKING_POLICY, name, "lite_biped")
    guards = guards_of(case.scenario.description)
    assert guards is not None
    assert case.suite.pushes is not None
    interval = 3.0 if push <= 0.2 else 1.0
    pushes = msgspec.structs.replace(case.suite.pushes, speed=push, interval=interval)
    suite = msgspec.structs.replace(case.suite, pushes=pushes)
    with watched(monkeypatch, guards) as (alarms, shares):
        done = episodes.run_episodes(replace(case, suite=suite), range(6), threads=2)
    assert any(episode.kind == "lost" for episode in done) is falls
    assert alarms == []
    assert max(shares) <= 0.75, "with room to spare"
