"""Pictures of poses, by the OpenGL of this machine, and whether it can open a window."""

from __future__ import annotations

import importlib
import os
import sys
import warnings
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


def check_window() -> None:
    """Raise `InputError` if MuJoCo's window cannot be opened."""
    reason = "no display: neither DISPLAY nor WAYLAND_DISPLAY is set"
    if has_display():
        try:
            import glfw  # noqa: PLC0415 - fails where its library is missing

            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                if glfw.init():
                    return
            reason = "the display does not answer"
        except (ImportError, OSError) as error:
            reason = str(error)
    raise InputError(f"viewer native: {reason}; --html out.html shows the run in a browser")


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
    """Pictures of a model's poses, by a camera that follows a floating base. Draw and close on the same thread."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Open a context; width and height in pixels. Raises `InputError` where OpenGL does not work."""
        opengl = choose_opengl()
        if not opengl:
            raise InputError("pictures: no OpenGL here; Debian's package libosmesa6 brings one")
        try:
            gl_context.GLContext = importlib.import_module(f"mujoco.{opengl}").GLContext
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # drivers raise anything: ImportError, AttributeError, FatalError, ...
            reason = f"OpenGL ({opengl}) does not work here: {type(error).__name__}: {error}"
            raise InputError(f"pictures: {reason}") from None
        self._model, self._data, self._camera = model, mujoco.MjData(model), mujoco.MjvCamera()
        mujoco.mjv_defaultFreeCamera(model, self._camera)
        if model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
            self._camera.type = mujoco.mjtCamera.mjCAMERA_TRACKING
            self._camera.trackbodyid = model.jnt_bodyid[0]

    def draw(self, qpos: FloatArray) -> npt.NDArray[np.uint8]:
        """Draw a pose (nq,), shape (height, width, 3), RGB."""
        update_pose(self._model, self._data, qpos)
        self._renderer.update_scene(self._data, self._camera)
        picture: npt.NDArray[np.uint8] = self._renderer.render()
        return picture

    def close(self) -> None:
        self._renderer.close()
