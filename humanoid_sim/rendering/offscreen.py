"""Pictures without a window: OpenGL where it works on this machine, the software painter everywhere else."""

from __future__ import annotations

import importlib
import textwrap
import warnings
from typing import Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.backend import Choice, choose_backend, egl_works
from humanoid_sim.rendering.camera import make_camera
from humanoid_sim.rendering.painter import Painter

__all__ = ["Renderer", "make_renderer", "update_pose"]

_failures: dict[str, str] = {}
"""Kinds of OpenGL that failed in this process. MuJoCo aborts when a context is asked for again after it failed once."""


class Renderer(Protocol):
    """Draws one model from one camera in one size."""

    @property
    def backend(self) -> str:
        """What draws, and why: one line for a person."""

    def render(self, data: mujoco.MjData) -> npt.NDArray[np.uint8]:
        """The picture, shape (height, width, 3), RGB, of the poses in `data` (see `update_pose`)."""

    def close(self) -> None:
        """Release the context. May be called twice."""


def make_renderer(
    model: mujoco.MjModel, width: int, height: int, camera: str | None = None, *, choice: Choice | None = None
) -> Renderer:
    """A renderer that works: an OpenGL that cannot make a context gives way to the painter, and `backend` says so.

    The model's visual settings are adapted: its off-screen buffer to the picture, its quality to OSMesa's speed. Render
    and close it on the thread that made it.

    Args:
        model: what to draw.
        width: pixels.
        height: pixels.
        camera: a camera of the model; None looks at the robot from the front.
        choice: what to draw with; None decides by the machine.

    Raises:
        InputError: if the model has no such camera.
    """
    view = make_camera(model, camera)
    choice = choice or choose_backend()
    reason = str(choice)
    if choice.opengl == "egl" and not egl_works():
        _failures["egl"] = "makes no context"
    if choice.opengl != "none" and choice.opengl not in _failures:
        try:
            return _OpenGLRenderer(model, width, height, view, choice)
        except Exception as error:  # drivers raise anything: ImportError, AttributeError, FatalError, ...
            _failures[choice.opengl] = _describe(error)
    if choice.opengl in _failures:
        reason = f"software painter ({choice}: {_failures[choice.opengl]})"
    painter = Painter(model, width, height, view)
    painter.backend = reason
    return painter


def update_pose(model: mujoco.MjModel, data: mujoco.MjData, qpos: FloatArray) -> bool:
    """Bring `data` to `qpos`, shape (nq,): positions of bodies, geoms, cameras and lights; no dynamics, no contacts.

    Returns:
        Whether it did: a `qpos` that is not finite leaves `data` as it was.
    """
    if not np.isfinite(qpos).all():
        return False
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)  # a camera that follows a body looks at its centre of mass
    mujoco.mj_camlight(model, data)
    return True


def _describe(error: Exception) -> str:
    try:
        text = str(error)
    except Exception:  # PyOpenGL's errors ask the broken driver for their text
        text = ""
    return textwrap.shorten(f"{type(error).__name__}: {text}", 90, placeholder=" ...")


class _OpenGLRenderer:
    """`mujoco.Renderer`, but for any context: that one takes what `MUJOCO_GL` said when MuJoCo was imported."""

    def __init__(
        self, model: mujoco.MjModel, width: int, height: int, camera: mujoco.MjvCamera, choice: Choice
    ) -> None:
        self.backend = str(choice)
        self._model, self._camera = model, camera
        self._size = width, height
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._option = mujoco.MjvOption()
        self._scene = mujoco.MjvScene(model, 2000)
        model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(height, model.vis.global_.offheight)
        if choice.opengl == "osmesa":  # on a processor, a scene's full quality takes 150 ms a picture; this takes half
            model.vis.quality.offsamples = min(4, model.vis.quality.offsamples)
            model.vis.quality.shadowsize = min(2048, model.vis.quality.shadowsize)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # GLFW warns, and then fails anyway
            self._window = importlib.import_module(f"mujoco.{choice.opengl}").GLContext(width, height)
            self._window.make_current()
            if choice.opengl == "glfw" and not importlib.import_module("glfw").get_current_context():
                raise RuntimeError("no window can be opened")
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)

    def render(self, data: mujoco.MjData) -> npt.NDArray[np.uint8]:
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._camera, every, self._scene)
        self._window.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        width, height = self._size
        picture = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(picture, None, self._rect, self._context)
        return np.ascontiguousarray(picture[::-1])  # OpenGL counts rows from the bottom

    def close(self) -> None:
        if self._context is not None:
            self._window.make_current()
            self._context.free()
            self._window.free()
            self._context = None
