"""What a robot's model knows of a recorded MuJoCo state beside its joints: the IMU, the base and the anchor body."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.golden.trace import BodyReader
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import FloatingBase
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.senses import BodySenses

__all__ = ["body_reader"]


def body_reader(description: RobotDescription, anchor_body: str) -> BodyReader:
    """Reads traces of this robot; the anchor body is left out where the policy has none.

    Raises:
        InputError: the robot's model lacks the anchor body.
    """
    model = build_model(description, scene=False)
    data = mujoco.MjData(model)
    base = FloatingBase(model, description, data.qpos.copy()) if description.is_floating else None
    senses = BodySenses(model, description, base, anchor_body)

    def read(qpos: FloatArray, qvel: FloatArray, joint_names: tuple[str, ...]) -> Mapping[str, FloatArray]:
        addresses = joint_addresses(model, joint_names)
        free = 7 if description.is_floating else 0
        if qpos.shape[1] != free + len(joint_names):
            whose = "a free joint" if free else "no free joint"
            raise InputError(
                f"trace: qpos is {qpos.shape[1]} wide, expected {free + len(joint_names)}: robot has {whose}"
            )
        rows: list[dict[str, FloatArray]] = []
        for position, velocity in zip(qpos, qvel, strict=True):
            if base is not None:
                joint = int(model.body_jntadr[model.body(description.base.body).id])
                start, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
                data.qpos[start : start + 7], data.qvel[dof : dof + 6] = position[:7], velocity[:6]
            data.qpos[addresses.qpos], data.qvel[addresses.dof] = position[free:], velocity[max(free - 1, 0) :]
            sample = senses.read(data)
            imu = {"imu_quaternion": sample.imu.quaternion, "imu_angular_velocity": sample.imu.angular_velocity}
            rows.append({**imu, **sample.live})
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}

    return read
