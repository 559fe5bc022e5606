"""Pictures of poses without a window, by the OpenGL of this machine."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from ctypes.util import find_library
from importlib.util import find_spec

import mujoco
import numpy as np
import numpy.typing as npt
from mujoco.rendering.classic import gl_context

from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.mit import FloatArray


def has_display() -> bool:
    """Return True if a window could be opened: on Linux, if the environment names an X or Wayland display."""
    return sys.platform in {"darwin", "win32"} or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def choose_opengl() -> str:
    """Return `glfw`, `osmesa` or `egl`: the one that `MUJOCO_GL` names, else one that is here; empty for none."""
    requested = os.environ.get("MUJOCO_GL", "").lower()
    if requested in ("glfw", "osmesa", "egl"):
        return requested
    if requested in ("disable", "off"):
        return ""
    if has_display():
        return "glfw"
    if find_library("OSMesa"):
        return "osmesa"
    return "egl" if find_library("EGL") else ""


def require_pictures(option: str) -> None:
    """Raise `InputError`, which names the option, where no picture can be drawn or encoded."""
    if not choose_opengl():
        raise InputError(f"{option}: no OpenGL here; --html FILE.html shows the run in a browser without")
    if find_spec("av") is None:
        raise MissingPackageError("av", "video", option)


def update_pose(model: mujoco.MjModel, data: mujoco.MjData, qpos: FloatArray) -> None:
    """Bring all that is drawn of `data` to `qpos`, shape (nq,); one that is not finite changes nothing."""
    if np.isfinite(qpos).all():
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)  # a camera that follows a body looks at its centre of mass
        mujoco.mj_camlight(model, data)


class PoseRenderer:
    """Pictures of a model's poses, by a camera that follows a floating base; width and height in pixels.

    Nothing is loaded before the first; draw and close on the same thread.
    """

    def __init__(self, model_factory: Callable[[], mujoco.MjModel], width: int, height: int) -> None:
        self._model_factory, self._width, self._height = model_factory, width, height
        self._renderer: mujoco.Renderer | None = None

    def draw(self, qpos: FloatArray) -> npt.NDArray[np.uint8]:
        """Draw a pose (nq,), shape (height, width, 3), RGB. Raises `InputError` where OpenGL does not work."""
        if self._renderer is None:
            self._model = self._model_factory()
            self._data = mujoco.MjData(self._model)
            self._camera = _default_camera(self._model)
            self._renderer = _make_renderer(self._model, self._width, self._height)
        update_pose(self._model, self._data, qpos)
        self._renderer.update_scene(self._data, self._camera)
        picture: npt.NDArray[np.uint8] = self._renderer.render()
        return picture

    def close(self) -> None:
        """Release the context. May be called twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _default_camera(model: mujoco.MjModel) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    if model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        camera.type, camera.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, model.jnt_bodyid[0]
    return camera


def _make_renderer(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    opengl = choose_opengl()
    if not opengl:
        raise InputError("pictures: no OpenGL here; Debian's package libosmesa6 brings one")
    try:
        gl_context.GLContext = importlib.import_module(f"mujoco.{opengl}").GLContext
        return mujoco.Renderer(model, height, width)
    except Exception as error:  # drivers raise anything: ImportError, AttributeError, FatalError, ...
        raise InputError(f"pictures: OpenGL ({opengl}) does not work here: {type(error).__name__}: {error}") from None
