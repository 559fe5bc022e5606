"""From where to look: a camera of the model by name, or a free one that frames the robot from the front."""

from __future__ import annotations

import math

import mujoco

from humanoid_sim.errors import InputError, known_names

__all__ = ["make_camera"]

_AZIMUTH = 155.0
"""Degrees. 180 looks along -x, straight at the face of a robot whose front is +x; 155 shows a little of its left."""
_ELEVATION = -14.0
_MARGIN = 1.3
"""Room around the robot at rest, for arms that are raised."""


def make_camera(model: mujoco.MjModel, name: str | None = None) -> mujoco.MjvCamera:
    """The model's camera `name`, or a front three-quarter view at the distance at which the whole robot fits.

    `<statistic center= extent=>` of the model decides what is framed. A robot with a floating base is followed.

    Raises:
        InputError: if the model has no camera `name`.
    """
    camera = mujoco.MjvCamera()
    if name is not None:
        camera.fixedcamid = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
        if camera.fixedcamid < 0:
            raise InputError(known_names("camera", name, (model.camera(index).name for index in range(model.ncam))))
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        return camera
    mujoco.mjv_defaultFreeCamera(model, camera)
    camera.lookat[:] = model.stat.center
    camera.azimuth, camera.elevation = _AZIMUTH, _ELEVATION
    half_view = math.radians(model.vis.global_.fovy) / 2
    camera.distance = _MARGIN * model.stat.extent / 2 / math.tan(half_view)
    base = _floating_base(model)
    if base is not None:
        camera.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        camera.trackbodyid = base
    return camera


def _floating_base(model: mujoco.MjModel) -> int | None:
    """The body that carries most of the model's mass on a free joint: a robot, and not a ball that lies about."""
    for body in model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]:
        if model.body_subtreemass[body] > model.body_subtreemass[0] / 2:
            return int(body)
    return None
