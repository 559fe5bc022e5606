"""Random motions of the whole robot for evaluation; the seeds of training give none of them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import mujoco
import numpy as np

from humanoid_sim.evaluation.tracking import peak_speed
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.training.arm import ArmModel
from humanoid_sim.training.mirror import both_arms
from humanoid_sim.training.motions import BODIES, POLICY_DT, joint_frames
from humanoid_sim.training.random_motions import random_motions

__all__ = ["collisions", "held_out_motions"]

_LEAST_SPEED = 0.5
"""m/s that one of the hands reaches."""
_STREAM = 77
"""Keeps evaluation apart from training, whatever the seed."""


def held_out_motions(description: RobotDescription, count: int, seed: int) -> list[Motion]:
    """`count` random motions of both arms from pose A, at rest there, without collisions."""
    arm = ArmModel(description)
    rng = np.random.default_rng([_STREAM, seed])
    paths = (path[::2] for path in random_motions(arm, rng) if np.abs(path[:3] - arm.home).max() < 1e-3)

    def motions() -> Iterator[Motion]:
        while True:
            path = both_arms(next(paths), next(paths))
            frames = joint_frames(description, path)
            hands = frames[:, : 3 * len(BODIES)].reshape(len(frames), len(BODIES), 3)
            if peak_speed(hands[:, 1::2], POLICY_DT) >= _LEAST_SPEED and not collisions(description, path[::5]):
                yield Motion(frames, BODIES, POLICY_DT, "tracking", description.name)

    return list(islice(motions(), count))


def collisions(description: RobotDescription, path: FloatArray) -> set[tuple[str, str]]:
    """Names of the bodies that touch anywhere on a joint path (F, n), rad."""
    model = build_model(description, scene=False)
    data = mujoco.MjData(model)
    qpos = joint_addresses(model, description.joint_names).qpos
    touching = set()
    for q in path:
        data.qpos[qpos] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for a, b in model.geom_bodyid[data.contact.geom]:
            touching.add((model.body(a).name, model.body(b).name))
    return touching
