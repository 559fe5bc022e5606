"""The frame of a robot's model that is its IMU."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.robots.schema import RobotDescription

_SITE = mujoco.mjtObj.mjOBJ_SITE
_SENSOR = mujoco.mjtSensor
_FRAME = (_SENSOR.mjSENS_ACCELEROMETER, _SENSOR.mjSENS_FRAMEQUAT, _SENSOR.mjSENS_FRAMEZAXIS, _SENSOR.mjSENS_FRAMEANGVEL)
"""Sensors of an orientation, or of how it moves; those of positions alone are often a foot's."""


def root_of(model: mujoco.MjModel, joint: int) -> int:
    """Return the body at the root of the tree that a joint is in: the base."""
    return int(model.body_rootid[model.jnt_bodyid[joint]])


def find_imu(model: mujoco.MjModel, base: int) -> tuple[str, str]:
    """Return the site or body that is the IMU of the robot with this base, and why.

    In this order: the site of a gyro on the base, or of the only gyro on the robot; a site of the base named like an
    IMU; the only site on the robot with a sensor of an orientation; the base itself.
    """
    sites = [i for i in np.flatnonzero(model.body_rootid[model.site_bodyid] == base).tolist() if model.site(i).name]
    gyros, frames = _with_sensor(model, sites, (_SENSOR.mjSENS_GYRO,)), _with_sensor(model, sites, _FRAME)
    named = [i for i in sites if "imu" in model.site(i).name.lower() and model.site_bodyid[i] == base]
    for found, why in (
        ([i for i in gyros if model.site_bodyid[i] == base], "the site of a gyro"),
        (gyros if len(gyros) == 1 else [], "the site of the only gyro"),
        (named, "a site of the base named like an IMU"),
        (frames if len(frames) == 1 else [], "the only site with a sensor of its orientation"),
    ):
        if found:
            return model.site(found[0]).name, why
    return model.body(base).name, "no site of the model is clearly the IMU"


def _with_sensor(model: mujoco.MjModel, sites: list[int], kinds: tuple[mujoco.mjtSensor, ...]) -> list[int]:
    """Return those of some sites that have such a sensor, in the order of the sensors."""
    chosen = np.isin(model.sensor_type, [int(kind) for kind in kinds]) & (model.sensor_objtype == int(_SITE))
    return [i for i in dict.fromkeys(model.sensor_objid[chosen].tolist()) if i in sites]


def imu_line(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Return which frame of a robot's model is its IMU, on which body, and why that one."""
    base = root_of(model, model.joint(description.joints[0].name).id)
    name, (found, why) = description.imu, find_imu(model, base)
    site = mujoco.mj_name2id(model, _SITE, name)
    body = model.body(int(model.site_bodyid[site]) if site >= 0 else name)
    owner = "the base" if body.id == base else f"not the base '{model.body(base).name}'"
    frame = f"site '{name}' on '{body.name}'" if site >= 0 else f"body '{name}'"
    return f"{frame}, {owner} ({why if name == found else 'as it was given'})"
