"""Pictures without a window, by OpenGL."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable

import mujoco
import numpy as np
import numpy.typing as npt
from mujoco.rendering.classic import gl_context

from humanoid_sim.errors import InputError, one_line
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.backend import choose_opengl
from humanoid_sim.rendering.camera import make_camera, tint_sides, update_pose

_GHOST = (0.10, 0.62, 0.92, 0.55)  # red, green, blue and opacity of the pose that a motion asks for
_failures: dict[str, str] = {}  # of this process: MuJoCo aborts when a context is created again after it failed once


class PoseRenderer:
    """Pictures of a model's poses. Nothing is loaded before the first; draw and close on the same thread.

    Width and height are in pixels. `camera` is one of the model's, or one that its owner moves between pictures; None
    looks at the robot from the front.
    """

    def __init__(
        self,
        model_factory: Callable[[], mujoco.MjModel],
        width: int,
        height: int,
        camera: str | mujoco.MjvCamera | None = None,
    ) -> None:
        self._model_factory, self._width, self._height, self._view = model_factory, width, height, camera
        self._renderer: mujoco.Renderer | None = None

    def draw(self, qpos: FloatArray, ghost: FloatArray | None = None) -> npt.NDArray[np.uint8]:
        """Draw a pose (nq,), shape (height, width, 3), RGB; the last finite one, if this is not finite.

        `ghost`, shape (nq,), is a second, translucent pose. Raises `InputError` where OpenGL does not work.
        """
        if self._renderer is None:
            self._model = model = self._model_factory()
            self._camera = make_camera(model, self._view)
            tint_sides(model)
            self._data, self._ghost = mujoco.MjData(model), mujoco.MjData(model)
            update_pose(model, self._data, model.qpos0)
            self._renderer = _make_renderer(model, self._width, self._height)
        update_pose(self._model, self._data, qpos)
        self._renderer.update_scene(self._data, self._camera)
        if ghost is not None and update_pose(self._model, self._ghost, ghost):
            scene = self._renderer.scene
            first, moving = scene.ngeom, mujoco.mjtCatBit.mjCAT_DYNAMIC.value
            mujoco.mjv_addGeoms(self._model, self._ghost, mujoco.MjvOption(), mujoco.MjvPerturb(), moving, scene)
            for geom in scene.geoms[first : scene.ngeom]:
                geom.rgba[:] = _GHOST
                geom.matid = -1
        picture: npt.NDArray[np.uint8] = self._renderer.render()
        return picture

    def close(self) -> None:
        """Release the context. May be called twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _make_renderer(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    """Return MuJoCo's renderer with the OpenGL of this machine; the model's visual settings are adapted."""
    opengl = choose_opengl()
    if opengl == "none":
        raise InputError("pictures: no OpenGL here; Debian's package libosmesa6 brings one")
    visual, buffer = model.vis, model.vis.global_
    buffer.offwidth, buffer.offheight = max(width, buffer.offwidth), max(height, buffer.offheight)
    if opengl != "glfw":  # on a processor, a scene's full quality takes 150 ms a picture; this takes half
        visual.quality.offsamples = min(4, visual.quality.offsamples)
        visual.quality.shadowsize = min(2048, visual.quality.shadowsize)
    if opengl not in _failures:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # GLFW warns, and then fails anyway
                gl_context.GLContext = importlib.import_module(f"mujoco.{opengl}").GLContext
                return mujoco.Renderer(model, height, width)
        except Exception as error:  # drivers raise anything: ImportError, AttributeError, FatalError, ...
            _failures[opengl] = one_line(f"{type(error).__name__}: {error}")[:90]
    raise InputError(f"pictures: OpenGL ({opengl}) does not work here: {_failures[opengl]}")
