"""The episodes of a regression run against the bare physics that they contain."""

from __future__ import annotations

import os

import mujoco
import numpy as np
from msgspec.structs import replace
from mujoco import rollout

from humanoid_sim.bench.timing import Row, paired_ratio
from humanoid_sim.play.options import SAMPLE_POLICY
from humanoid_sim.regress.episodes import EpisodeBatch
from humanoid_sim.regress.runner import prepare_contest
from humanoid_sim.regress.subject import load_subject, suite_robot
from humanoid_sim.regress.suite_file import load_suite
from humanoid_sim.simulation.model import joint_addresses

__all__ = ["regress_speed"]

_EPISODES = 1024
_STEPS = 5
"""Policy steps of each: 0.1 s, 200 physics steps."""


def regress_speed(repetitions: int) -> list[Row]:
    """The sample policy over a suite of the Lite's: inference, disturbances, measures and judging over bare rollouts.

    Both step the same models, each episode's own, as many at a time and on as many threads. Building the batch, once
    per case, is left out on both sides.
    """
    suite, folder = load_suite("lite_tracking")
    period = 0.02
    suite = replace(suite, cases=(replace(suite.cases[0], duration=_STEPS * period),))
    contest = prepare_contest(suite, folder, suite_robot(suite, folder, None))
    arena = contest.arenas(load_subject(SAMPLE_POLICY, None, contest.description, suite))[0]
    batch = EpisodeBatch(suite, arena, range(_EPISODES), contest.disturbance)
    bare = _BareRollout(batch)

    def describe(ours: float, physics: float) -> str:
        count = _EPISODES * _STEPS
        return f"{count / ours:.0f} policy steps per s, {count / physics:.0f} bare; {physics / ours:.2f} of it"

    name = f"regress, {_EPISODES} episodes, over bare rollout"
    try:
        return [paired_ratio(name, batch.run, bare.run, repetitions, 1.0 / 0.70, describe)]
    finally:
        batch.close()
        bare.close()


class _BareRollout:
    """The physics of a batch alone: every robot holds the pose in which it starts."""

    def __init__(self, batch: EpisodeBatch) -> None:
        simulation = batch.simulation
        batch.run()  # the gains are in the models once a command has been given
        self._models = [simulation.model(i) for i in range(simulation.count)]
        model = self._models[0]
        full = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._initial = np.zeros((simulation.count, mujoco.mj_stateSize(model, full)))
        self._initial[:, 1 : 1 + model.nq] = simulation.qpos
        held = simulation.qpos[:, joint_addresses(model, simulation.joints).qpos]
        stiffness = np.array([-m.actuator_biasprm[:, 1] for m in self._models])
        self._control = np.repeat((stiffness * held)[:, None], simulation.physics_steps, axis=1)
        self._path = np.zeros((*self._control.shape[:2], self._initial.shape[1]))
        self._velocity = slice(1 + model.nq, 1 + model.nq + model.nv)
        self._timestep = model.opt.timestep
        threads = len(os.sched_getaffinity(0))
        self._data = [mujoco.MjData(model) for _ in range(threads)]
        self._rollout = rollout.Rollout(nthread=threads if threads > 1 else 0)

    def run(self) -> None:
        """As many physics steps as an episode has, in as many calls as it has policy steps."""
        state, path = self._initial, self._path
        acceleration = np.zeros((len(state), self._velocity.stop - self._velocity.start))
        for _ in range(_STEPS):
            self._rollout.rollout(
                self._models,
                self._data,
                state,
                self._control,
                nstep=self._control.shape[1],
                skip_checks=True,
                initial_warmstart=acceleration,
                state=path,
            )
            state = path[:, -1].copy()
            acceleration = (state - path[:, -2])[:, self._velocity] / self._timestep

    def close(self) -> None:
        """Stop the threads."""
        self._rollout.close()
