"""How a model is looked at, in pictures, windows and pages: the camera, the pose, and colours of left and right."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.piano import key_joint_names

_FRONT = (
    155.0,
    -14.0,
)  # degrees of azimuth and elevation, at the face of a robot that looks along +x
_AT_PIANO = 170.0, -46.0  # so steep that the keys show above the piano's rear
_ROOM = 1.3  # distance, as a share of the model's extent
_ABOVE_KEYS = np.array([-0.13, 0.0, 0.11])  # m from the middle of the keys to what is looked at
_LEFT, _RIGHT = (0.36, 0.60, 0.86), (0.93, 0.62, 0.32)
_CAMERA = mujoco.mjtObj.mjOBJ_CAMERA
_MIDDLE = 0.04  # m beside the plane of symmetry, within which a body is neither left nor right


def make_camera(model: mujoco.MjModel, name: str | mujoco.MjvCamera | None = None) -> mujoco.MjvCamera:
    """Return the model's camera `name`, or a view of the robot from the front, which follows a floating base."""
    if isinstance(name, mujoco.MjvCamera):
        return name
    camera = mujoco.MjvCamera()
    if name is not None:
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, mujoco.mj_name2id(model, _CAMERA, name)
        if camera.fixedcamid < 0:
            raise InputError(known_names("camera", name, (model.camera(index).name for index in range(model.ncam))))
        return camera
    data = mujoco.MjData(model)
    update_pose(model, data, model.qpos0)
    camera.azimuth, camera.elevation = _FRONT
    camera.distance = _ROOM * model.stat.extent
    base = floating_base(model)
    keys = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in key_joint_names()]
    if min(keys) >= 0:
        camera.azimuth, camera.elevation = _AT_PIANO
        camera.distance = model.stat.extent
        camera.lookat[:] = data.xpos[model.jnt_bodyid[keys]].mean(axis=0) + _ABOVE_KEYS
    elif base is not None:
        camera.type, camera.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, base
        camera.lookat[:] = data.subtree_com[base]
    else:
        camera.lookat[:] = data.subtree_com[0] if model.body_subtreemass[0] else model.stat.center
    return camera


def floating_base(model: mujoco.MjModel) -> int | None:
    """Return the body that carries most of the model's mass on a free joint: a robot, and not a ball."""
    for body in model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]:
        if model.body_subtreemass[body] > model.body_subtreemass[0] / 2:
            return int(body)
    return None


def update_pose(model: mujoco.MjModel, data: mujoco.MjData, qpos: FloatArray) -> bool:
    """Bring `data` to `qpos`, shape (nq,): positions of bodies, geoms, cameras and lights; no dynamics, no contacts.

    Returns False for a `qpos` that is not finite, which leaves `data` as it was.
    """
    if not np.isfinite(qpos).all():
        return False
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)  # a camera that follows a body looks at its centre of mass
    mujoco.mj_camlight(model, data)
    return True


def tint_sides(model: mujoco.MjModel) -> None:
    """Colour the left and right limbs of a robot that is all of one colour: else nobody sees which leg is in front."""
    data = mujoco.MjData(model)
    update_pose(model, data, model.qpos0)
    moving = np.isin(model.body_rootid, model.body_rootid[model.jnt_bodyid])[model.geom_bodyid]
    geoms = np.flatnonzero(moving & (model.geom_matid < 0) & (model.geom_rgba[:, 3] > 0.0))
    if not len(geoms) or np.ptp(model.geom_rgba[geoms, :3], axis=0).max() > 0.0:
        return
    side = data.xpos[model.geom_bodyid[geoms], 1]
    model.geom_rgba[geoms[side > _MIDDLE], :3] = _LEFT
    model.geom_rgba[geoms[side < -_MIDDLE], :3] = _RIGHT
