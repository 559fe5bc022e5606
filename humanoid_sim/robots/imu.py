"""The frame of a model that is the robot's IMU."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.robots.schema import RobotDescription


def find_imu(model: mujoco.MjModel, base: int) -> tuple[str, str]:
    """Return the site or body that is the IMU of the robot with this base, and why.

    In this order: the site of a gyro on the base, or of the only gyro on the robot; a site of the base named like an
    IMU; the base itself.
    """
    sites = [i for i in np.flatnonzero(model.body_rootid[model.site_bodyid] == base).tolist() if model.site(i).name]
    is_gyro = model.sensor_type == mujoco.mjtSensor.mjSENS_GYRO
    gyros = [i for i in model.sensor_objid[is_gyro].tolist() if i in sites]
    named = [i for i in sites if "imu" in model.site(i).name.lower()]
    for i in gyros:
        if model.site_bodyid[i] == base:
            return model.site(i).name, "the site of a gyro"
    if len(set(gyros)) == 1:
        return model.site(gyros[0]).name, "the site of the only gyro"
    for i in named:
        if model.site_bodyid[i] == base:
            return model.site(i).name, "a site of the base named like an IMU"
    others = ", ".join(model.site(i).name for i in dict.fromkeys(gyros + named))
    return model.body(base).name, f"no site is clearly the IMU; sites that could be it: {others or 'none'}"


def imu_line(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Return which frame of a robot's model is its IMU, on which body, and why that one."""
    base = int(model.body_rootid[model.jnt_bodyid[model.joint(description.joint_names[0]).id]])
    name, (found, why) = description.imu, find_imu(model, base)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    body = model.body(int(model.site_bodyid[site]) if site >= 0 else name)
    frame = f"site '{name}' on" if site >= 0 else "the frame of"
    root = model.body(base).name
    owner = f"the base '{root}'" if body.id == base else f"'{body.name}', not the base '{root}'"
    return f"{frame} {owner} ({why if name == found else 'as it was given'})"
