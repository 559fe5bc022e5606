"""The episodes of a regression run against the bare physics that they contain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from msgspec.structs import replace as changed

from humanoid_sim.bench.bare_rollout import BareRollout
from humanoid_sim.bench.timing import Row, paired_ratio
from humanoid_sim.controllers.action import action_command
from humanoid_sim.play.options import SAMPLE_POLICY
from humanoid_sim.regress.episodes import Disturbance, EpisodeBatch, Step
from humanoid_sim.regress.runner import prepare_contest
from humanoid_sim.regress.subject import load_subject, suite_robot
from humanoid_sim.regress.suite_file import load_suite

__all__ = ["regress_speed"]

_EPISODES = 1024
_STEPS = 5
"""Policy steps of each: 0.1 s, 200 physics steps."""


def regress_speed(repetitions: int) -> list[Row]:
    """The sample policy over a suite: inference, disturbances, measures and judging included.

    The robots differ as the suite has it, but for the delay of their commands, which the bare physics has not. What is
    built once per case is left out on both sides.
    """
    batch = _episodes()
    steps: list[Step] = []
    batch.run(steps)
    reached = batch.simulation.qpos.copy()
    action_map = batch.arena.setting.side.action_map
    targets = [action_command(action_map, step.action).position for step in steps if step.action is not None]
    bare = BareRollout(batch.simulation, steps[0].qpos, steps[0].qvel, targets)
    bare.run()
    if not np.allclose(bare.qpos, reached, rtol=0.0, atol=1e-9):
        raise AssertionError("the bare physics is not that of the episodes")

    def describe(ours: float, physics: float) -> str:
        count = _EPISODES * _STEPS
        threads = batch.simulation.threads
        return f"{count / ours:.0f} policy steps per s, {count / physics:.0f} bare, {threads} threads"

    name = f"regress, {_EPISODES} episodes, over bare rollout"
    try:
        return [paired_ratio(name, batch.run, bare.run, repetitions, 0.70, describe, speed=True)]
    finally:
        batch.close()
        bare.close()


def _episodes() -> EpisodeBatch:
    suite, folder = load_suite("lite_tracking")
    suite = changed(suite, cases=suite.cases[:1])
    contest = prepare_contest(suite, folder, suite_robot(suite, folder, None))
    (arena,) = contest.arenas(load_subject(SAMPLE_POLICY, None, contest.description, suite))
    drawn = replace(suite.draw(), command_delay=(0.0, 0.0))
    return EpisodeBatch(suite, replace(arena, steps=_STEPS), range(_EPISODES), Disturbance(drawn))
