"""Place of a robot's IMU, as far as its MJCF tells: found for robots that do not say, and named for people."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from humanoid_sim.robots.schema import RobotDescription

_GYRO = (mujoco.mjtSensor.mjSENS_GYRO,)
_FRAME = (
    mujoco.mjtSensor.mjSENS_ACCELEROMETER,
    mujoco.mjtSensor.mjSENS_VELOCIMETER,
    mujoco.mjtSensor.mjSENS_FRAMEQUAT,
    mujoco.mjtSensor.mjSENS_FRAMEXAXIS,
    mujoco.mjtSensor.mjSENS_FRAMEYAXIS,
    mujoco.mjtSensor.mjSENS_FRAMEZAXIS,
    mujoco.mjtSensor.mjSENS_FRAMEANGVEL,
    mujoco.mjtSensor.mjSENS_FRAMELINACC,
)
"""Sensors of an orientation, or of how it moves; those of positions alone are often a foot's."""


def find_imu(model: mujoco.MjModel, base: int) -> tuple[str, str]:
    """Return the site or body that is the IMU of the robot with this base, and why.

    In this order: the site of a gyro on the base, or of the only gyro on the robot; a site of the base named like an
    IMU; the only site on the robot with a sensor of an orientation; the base itself.
    """
    gyros, frames = _sites(model, base, _GYRO), _sites(model, base, _FRAME)
    named = [
        i
        for i in range(model.nsite)
        if model.body_rootid[model.site_bodyid[i]] == base and "imu" in model.site(i).name.lower()
    ]
    for sites, what in ((_on(model, base, gyros), "a gyro"), (gyros if len(gyros) == 1 else [], "the only gyro")):
        if sites:
            return model.site(sites[0]).name, f"the site of {what}"
    if _on(model, base, named):
        return model.site(_on(model, base, named)[0]).name, "a site of the base named like an IMU"
    if len(frames) == 1:
        return model.site(frames[0]).name, "the only site with a sensor of its orientation"
    others = list(dict.fromkeys(model.site(i).name for i in (*gyros, *frames, *named)))
    elsewhere = f"; other sites could be it: {', '.join(others)}" if others else ""
    return model.body(base).name, f"no site of the model is clearly the IMU{elsewhere}"


def _sites(model: mujoco.MjModel, base: int, kinds: Sequence[mujoco.mjtSensor]) -> list[int]:
    """Named sites of the robot that have such a sensor, once each."""
    found = []
    for i in range(model.nsensor):
        if mujoco.mjtSensor(int(model.sensor_type[i])) in kinds and model.sensor_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
            site = int(model.sensor_objid[i])
            is_ours = model.body_rootid[model.site_bodyid[site]] == base
            if is_ours and model.site(site).name and site not in found:
                found.append(site)
    return found


def _on(model: mujoco.MjModel, base: int, sites: list[int]) -> list[int]:
    return [site for site in sites if model.site_bodyid[site] == base]


def imu_line(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Give which frame of a robot's model is its IMU, on which body, and why that one; the model has what it names."""
    base = int(model.body_rootid[model.jnt_bodyid[model.joint(description.joints[0].name).id]])
    name, (found, why) = description.imu, find_imu(model, base)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    body = int(model.site_bodyid[site]) if site >= 0 else mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    owner, root = model.body(body).name, model.body(base).name
    reason = why if name == found else "as it was given"
    if site < 0:
        where = f"the base '{owner}' itself" if body == base else f"body '{owner}', not the base '{root}'"
    else:
        where = f"site '{name}' on " + (f"the base '{owner}'" if body == base else f"'{owner}', not the base '{root}'")
    return f"{where} ({reason})"
