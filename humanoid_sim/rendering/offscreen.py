"""Pictures without a window, by OpenGL, and the camera that looks at the robot, here, in the window and in a page."""

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
from humanoid_sim.rendering.appearance import keyboard_box, robot_box, tint_limbs
from humanoid_sim.rendering.backend import Choice, choose_backend, egl_works

_AZIMUTH = 155.0
"""Degrees. 180 looks along -x, straight at the face of a robot whose front is +x; 155 shows a little of its left."""
_ELEVATION = -14.0
_AT_PIANO = 170.0, -46.0
"""Degrees of azimuth and elevation, for a robot at a piano: so steep that the keys show above the piano's rear."""
_PIANO_MARGIN = 1.8
"""Room around a piano's width: the robot behind it is as high as that is wide."""
_TOWARDS_ROBOT, _ABOVE_KEYS = 0.13, 0.11
"""m from the middle of the keys to what is looked at."""
_MARGIN = 1.2
"""Room around a robot that walks, for arms that are raised; one that stands fast is framed with all that it reaches."""

_failures: dict[str, str] = {}
"""Kinds of OpenGL that failed in this process. MuJoCo aborts when a context is asked for again after it failed once."""
_GHOST = (0.10, 0.62, 0.92, 0.55)
"""Red, green, blue and opacity of the pose that a motion asks for."""


def make_renderer(
    model: mujoco.MjModel, width: int, height: int, camera: str | mujoco.MjvCamera | None = None, *, choice: Choice
) -> _OpenGLRenderer:
    """Return a renderer. Raises `InputError` where OpenGL does not work.

    The model's visual settings are adapted: its off-screen buffer to the picture, its quality to OSMesa's speed. The
    arguments are those of `PoseRenderer`.
    """
    view = make_camera(model, camera, width / height)
    tint_limbs(model)
    if choice.opengl == "none":
        raise InputError(f"pictures: {choice} here; Debian's package libosmesa6 brings one")
    if choice.opengl == "egl" and not egl_works():
        _failures["egl"] = "makes no context"
    if choice.opengl not in _failures:
        try:
            return _OpenGLRenderer(model, width, height, view, choice)
        except Exception as error:  # drivers raise anything: ImportError, AttributeError, FatalError, ...
            _failures[choice.opengl] = _describe(error)
    raise InputError(f"pictures: OpenGL does not work here: {choice}: {_failures[choice.opengl]}")


class PoseRenderer:
    """Pictures of a model's poses. Nothing is loaded before the first; draw and close on the same thread.

    Width and height are in pixels. `camera` is one of the model's, or one that its owner moves between pictures; None
    looks at the robot from the front.
    """

    backend = ""
    """Name of what draws, and the reason; empty before the first picture."""

    def __init__(
        self,
        model_factory: Callable[[], mujoco.MjModel],
        width: int,
        height: int,
        camera: str | mujoco.MjvCamera | None = None,
    ) -> None:
        self._model_factory, self._view = model_factory, (width, height, camera)
        self._renderer: _OpenGLRenderer | None = None
        self._ghost: mujoco.MjData | None = None

    def draw(self, qpos: FloatArray, ghost: FloatArray | None = None) -> npt.NDArray[np.uint8]:
        """Draw a pose (nq,), shape (height, width, 3), RGB; the last finite one, if this is not finite.

        `ghost`, shape (nq,), is a second pose, which the robot is shown to differ from. Raises `InputError` where
        OpenGL does not work.
        """
        if self._renderer is None:
            self._model = self._model_factory()
            self._data = mujoco.MjData(self._model)
            update_pose(self._model, self._data, self._data.qpos.copy())
            self._renderer = make_renderer(self._model, *self._view, choice=choose_backend())
            self.backend = self._renderer.backend
        update_pose(self._model, self._data, qpos)
        if ghost is None:
            return self._renderer.render(self._data)
        if self._ghost is None:
            self._ghost = mujoco.MjData(self._model)
        shown = update_pose(self._model, self._ghost, ghost)
        return self._renderer.render(self._data, self._ghost if shown else None)

    def close(self) -> None:
        """Release the context. May be called twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def make_camera(
    model: mujoco.MjModel, name: str | mujoco.MjvCamera | None = None, aspect: float = 4 / 3
) -> mujoco.MjvCamera:
    """Return the model's camera `name`, or a front three-quarter view at the distance at which the whole robot fits.

    A camera is returned as it is.

    `aspect` is the picture's width over its height. A model in which nothing has a joint is framed as its
    `<statistic center= extent=>` says. A robot with a floating base is followed; one at a piano is seen from above.
    """
    if isinstance(name, mujoco.MjvCamera):
        return name
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
    keyboard = keyboard_box(model)
    if keyboard is not None:
        camera.azimuth, camera.elevation = _AT_PIANO
        middle, half = keyboard
        camera.lookat[:] = middle + np.array([-_TOWARDS_ROBOT, 0.0, _ABOVE_KEYS])
        camera.distance = _PIANO_MARGIN * half[1] / (math.tan(half_view) * min(aspect, 16 / 9))
        return camera
    base = floating_base(model)
    half_height, depth = _MARGIN * model.stat.extent / 2, 0.0
    box = robot_box(model, moving=base is None)
    if box is not None:
        camera.lookat[:] = (box[0] + box[1]) / 2
        half = (box[1] - box[0]) / 2
        half_height = (1.0 if base is None else _MARGIN) * max(float(half[2]), float(half[1]) / aspect)
        depth = float(half[0]) / 2
    camera.distance = half_height / math.tan(half_view) + depth
    if base is not None:
        camera.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        camera.trackbodyid = base
    return camera


def floating_base(model: mujoco.MjModel) -> int | None:
    """Give the body that carries most of the model's mass on a free joint: a robot, and not a ball that lies about."""
    for body in model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]:
        if model.body_subtreemass[body] > model.body_subtreemass[0] / 2:
            return int(body)
    return None


def update_pose(model: mujoco.MjModel, data: mujoco.MjData, qpos: FloatArray) -> bool:
    """Bring `data` to `qpos`, shape (nq,): positions of bodies, geoms, cameras and lights; no dynamics, no contacts.

    Returns whether it did: a `qpos` that is not finite leaves `data` as it was.
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
        if choice.opengl != "glfw":  # on a processor, a scene's full quality takes 150 ms a picture; this takes half
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

    def render(self, data: mujoco.MjData, ghost: mujoco.MjData | None = None) -> npt.NDArray[np.uint8]:
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._camera, every, self._scene)
        if ghost is not None:
            first, moving = self._scene.ngeom, mujoco.mjtCatBit.mjCAT_DYNAMIC.value
            mujoco.mjv_addGeoms(self._model, ghost, self._option, mujoco.MjvPerturb(), moving, self._scene)
            for geom in self._scene.geoms[first : self._scene.ngeom]:
                geom.rgba[:] = _GHOST
                geom.matid = -1
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
