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


@pytest.mark.soak
@pytest.mark.parametrize(
    ("suite", "policy", "name", "robot", "push", "most"),
    [
        ("lite_tracking", SAMPLE_POLICY, "drum", None, 0.0, 0.5),
        ("velocity", WALKING_POLICY, "forward", "lite_biped", 0.2, 0.75),
        ("velocity", WALKING_POLICY, "turn", "lite_biped", 0.2, 0.75),
        ("velocity", WALKING_POLICY, "forward", "lite_biped", 1.5, 0.75),  # it falls: up to there no guard may speak
    ],
)
def test_no_alarm_in_motions_walking_pushes_and_falls(suite, policy, name, robot, push, most, monkeypatch):
    prepared = prepare_policy(prepare_suite(*load_suite(suite), robot), policy)
    case = next(case for case in prepared.cases if case.case.name == name)
    if push:
        interval = 3.0 if push <= 0.2 else 1.0
        pushes = msgspec.structs.replace(case.suite.pushes, speed=push, interval=interval)
        case = replace(case, suite=msgspec.structs.replace(case.suite, pushes=pushes))
    with watched(monkeypatch, guards_of(case.scenario.description)) as (alarms, shares):
        done = episodes.run_episodes(case, range(6), threads=2)
    assert any(episode.failure for episode in done) is (push > 1.0)
    assert alarms == []
    assert max(shares) <= most, "with room to spare"
