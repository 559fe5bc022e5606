"""Pictures without a window: OpenGL where it works on this machine, the software painter everywhere else.

With the camera that looks at the robot, here and in the window.
"""

from __future__ import annotations

import importlib
import math
import textwrap
import warnings
from collections.abc import Callable

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.backend import Choice, choose_backend, egl_works
from humanoid_sim.rendering.painter import Painter

__all__ = ["PoseRenderer", "make_camera", "make_renderer", "update_pose"]

_AZIMUTH = 155.0
"""Degrees. 180 looks along -x, straight at the face of a robot whose front is +x; 155 shows a little of its left."""
_ELEVATION = -14.0
_MARGIN = 1.3
"""Room around the robot at rest, for arms that are raised."""

_failures: dict[str, str] = {}
"""Kinds of OpenGL that failed in this process. MuJoCo aborts when a context is asked for again after it failed once."""


def make_renderer(
    model: mujoco.MjModel, width: int, height: int, camera: str | None = None, *, choice: Choice
) -> _OpenGLRenderer | Painter:
    """A renderer that works: an OpenGL that cannot make a context gives way to the painter, and `backend` says so.

    The model's visual settings are adapted: its off-screen buffer to the picture, its quality to OSMesa's speed. The
    arguments are those of `PoseRenderer`.

    Raises:
        InputError: if the model has no such camera.
    """
    view = make_camera(model, camera)
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


class PoseRenderer:
    """Pictures of a model's poses. Nothing is loaded before the first; draw and close on the same thread.

    Args:
        model_factory: makes the model to draw.
        width: pixels.
        height: pixels.
        camera: a camera of the model; None looks at the robot from the front.
        choose: decides what to draw with.
    """

    backend = ""
    """What draws, and why; empty before the first picture."""

    def __init__(
        self,
        model_factory: Callable[[], mujoco.MjModel],
        width: int,
        height: int,
        camera: str | None = None,
        *,
        choose: Callable[[], Choice] = choose_backend,
    ) -> None:
        self._model_factory, self._view, self._choose = model_factory, (width, height, camera), choose
        self._renderer: _OpenGLRenderer | Painter | None = None

    def draw(self, qpos: FloatArray) -> npt.NDArray[np.uint8]:
        """The picture of a pose (nq,), shape (height, width, 3), RGB; of the last finite one, if this is not finite.

        Raises:
            InputError: the model has no such camera.
        """
        if self._renderer is None:
            self._model = self._model_factory()
            self._data = mujoco.MjData(self._model)
            self._renderer = make_renderer(self._model, *self._view, choice=self._choose())
            self.backend = self._renderer.backend
            update_pose(self._model, self._data, self._data.qpos.copy())
        update_pose(self._model, self._data, qpos)
        return self._renderer.render(self._data)

    def close(self) -> None:
        """Release the context. May be called twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


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
    """`mujoco.Renderer`, but for any context: that one takes what `MUJOCO_GL` said when MuJoCo was imported.

    Its members are the painter's.
    """

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
