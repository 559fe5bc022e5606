"""Record a policy's run in its training environment, for golden vectors: `policy stamp --trace`."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import closing
from typing import Any

import mujoco
import numpy as np

from humanoid_sim.envs.config import Scenario
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.mit import Float32Array
from humanoid_sim.policy.traces import STATE_ARRAYS
from humanoid_sim.simulation.batch_sim import BatchSim


def record_trace(
    scenario: Scenario,
    policy: Callable[[Float32Array], Float32Array],
    output: str | os.PathLike[str],
    *,
    steps: int = 100,
) -> int:
    """Write the arrays that docs/golden-vectors.md lists, one row per policy step; returns the number of steps.

    The robot is as its model says, without randomisation. The run ends early where the policy or the simulation fails.
    Raises `InputError` if the policy's first action would be refused on any robot, or the file cannot be written.

    Args:
        scenario: of the environment, `envs.unwrapped.scenario`.
        policy: raw actions (1, m) for observations (1, N), as the trainer's own network computes them.
        output: the trace (.npz).
        steps: at most.
    """
    path = output_file(output, "output", ".npz")
    simulation = BatchSim(scenario.description, 1, scenario.sim_config, implicit=scenario.config.implicit, threads=1)
    start = scenario.starts(np.random.default_rng(0).random((1, scenario.starts.draws)))
    fastest = int(np.argmax((start.commands[0] ** 2).sum(axis=1)))  # not one to stand: a zero shows no scale
    rows: list[dict[str, Any]] = []
    with closing(simulation):
        simulation.reset(qpos=start.qpos, qvel=start.qvel)
        loop = ClosedLoop(simulation, scenario.wiring, start.commands[:, fastest])
        while len(rows) < min(steps, scenario.task.episode_steps) and not simulation.fault.any():
            observation, state = loop.observation.copy(), loop.state
            action = policy(observation)
            if not (np.isfinite(observation).all() and loop.wiring.accepts(action).all()):
                break
            row = {name: getattr(state, name) for name in STATE_ARRAYS}
            row |= {name: extern.value for name, extern in state.extern.items()}
            row |= {"observation": observation, "action": action, "target": loop.act(action).position}
            rows.append({name: np.array(value[0]) for name, value in row.items()})
    if not rows:
        raise InputError("policy: its first action is not finite or beyond the limits, which no controller accepts")
    table: dict[str, Any] = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    table |= {"joint_names": np.array(scenario.description.joint_names), "mujoco_version": mujoco.__version__}
    with whole_file(path) as file:
        np.savez_compressed(file, **table)
    return len(rows)
