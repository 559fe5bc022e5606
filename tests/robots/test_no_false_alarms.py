"""No guard trips on a healthy robot: sample motions, and legs that walk, are pushed, and fall."""

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


@pytest.mark.soak
@pytest.mark.parametrize(
    ("suite", "policy", "name", "robot", "push"),
    [
        ("lite_tracking", SAMPLE_POLICY, "drum", None, 0.0),
        ("velocity", WALKING_POLICY, "forward", "lite_biped", 0.2),
        ("velocity", WALKING_POLICY, "turn", "lite_biped", 0.2),
        ("velocity", WALKING_POLICY, "forward", "lite_biped", 1.5),  # it falls: up to there no guard may speak
    ],
)
def test_no_alarm_in_motions_walking_pushes_and_falls(suite, policy, name, robot, push, monkeypatch):
    prepared = prepare_policy(prepare_suite(*load_suite(suite), robot), policy)
    case = next(case for case in prepared.cases if case.case.name == name)
    if push:
        pushes = msgspec.structs.replace(case.suite.pushes, speed=push, interval=1.0 if push > 1.0 else 3.0)
        case = replace(case, suite=msgspec.structs.replace(case.suite, pushes=pushes))
    guards, alarms = guards_of(case.scenario.description), []
    strict = replace(guards, following_time=0.75 * guards.following_time)  # with room to spare

    class Watched(ClosedLoop):
        def __init__(self, *arguments):
            super().__init__(*arguments, guards=strict)

        def act(self, action, *, where, **rest):
            command = super().act(action, where=where, **rest)
            alarms.extend(self.alarm(int(i)) for i in np.flatnonzero(self.tripped & where))
            return command

    monkeypatch.setattr(episodes, "ClosedLoop", Watched)
    done = episodes.run_episodes(case, range(6), threads=2)
    assert any(episode.failure for episode in done) is (push > 1.0)
    assert alarms == []
