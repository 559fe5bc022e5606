"""A run of a trained network as it was trained: what golden vectors are taken from."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.envs.scenario import Scenario
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.simulation.batch import BatchSimulation
from humanoid_sim.training.ppo.actor import Actor

__all__ = ["training_run"]

_STEPS = 100


def training_run(scenario: Scenario, actor: Actor, seed: int) -> dict[str, npt.NDArray[Any]]:
    """The arrays of a trace, as `docs/golden-vectors.md` lists them, one row per policy step.

    The actions are the library's own, not those of the exported file. The run ends early where the robot is no longer
    sound.

    Raises:
        InputError: the policy's first action would be refused on any robot.
    """
    simulation = BatchSimulation(
        scenario.description,
        1,
        control_period=scenario.contract.policy_dt,
        physics_timestep=scenario.physics_timestep,
        actuation="implicit" if scenario.actuation == "implicit" else "affine",
        threads=1,
        anchor_body=scenario.contract.anchor_body,
        velocity_at=scenario.velocity_points,
        height_scan=scenario.contract.height_scan,
        bodies=scenario.bodies,
    )
    start = scenario.task.start(np.random.default_rng(seed).random((1, scenario.task.draws)))
    moving = np.linalg.norm(start.commands[0], axis=1)
    command = start.commands[:, int(np.argmax(moving))]  # of a policy that walks, one that is not to stand
    rows: list[dict[str, npt.NDArray[Any]]] = []
    with closing(simulation):
        simulation.reset(
            [0],
            joint_position=start.joint_position,
            joint_velocity=start.joint_velocity,
            base_yaw=start.base_yaw,
        )
        loop = ClosedLoop(simulation, scenario.wiring, command, scenario.live)
        for _ in range(min(_STEPS, scenario.task.episode_steps)):
            observation, state = loop.observation.copy(), loop.state
            action = actor.answer(observation)
            if not (np.isfinite(observation).all() and loop.wiring.accepts(action).all()):
                break
            row: dict[str, Any] = {
                "observation": observation,
                "action": action,
                "joint_position": state.joint_position,
                "joint_velocity": state.joint_velocity,
                "imu_quaternion": state.imu_quaternion,
                "imu_angular_velocity": state.imu_angular_velocity,
                "imu_linear_acceleration": state.imu_linear_acceleration,
                **{name: extern.value for name, extern in state.extern.items()},
            }
            row["target"] = loop.act(action).position
            rows.append({name: np.array(value[0]) for name, value in row.items()})
            if simulation.fault.any():
                break
    if not rows:
        raise InputError(
            "the policy's first action is one that no controller accepts; train on, or with another --seed"
        )
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]} | {
        "joint_names": np.array(scenario.description.joint_names)
    }
