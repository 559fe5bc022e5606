"""Gymnasium's render modes: pictures without a window, and MuJoCo's own window."""

from __future__ import annotations

from time import perf_counter, sleep
from typing import ClassVar

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.backend import choose_video_backend
from humanoid_sim.rendering.native_viewer import NativeViewerSink
from humanoid_sim.rendering.offscreen import Renderer, make_renderer, update_pose
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model

__all__ = ["RENDER_MODES", "Pictures", "Window", "check_render_mode"]

RENDER_MODES = ["human", "rgb_array"]


def check_render_mode(mode: str | None) -> None:
    """Refuse a render mode that there is not.

    Raises:
        InputError: naming those that there are.
    """
    if mode is not None and mode not in RENDER_MODES:
        raise InputError(f"render_mode: is {mode!r}, expected {', '.join(RENDER_MODES)} or None")


class Pictures:
    """`rgb_array`: pictures of a robot, drawn by what works on this machine with a model of their own."""

    def __init__(self, description: RobotDescription, width: int, height: int, camera: str | None) -> None:
        """Get ready to draw; nothing is loaded before the first picture.

        Args:
            description: of the robot.
            width: pixels.
            height: pixels.
            camera: of the model; None looks at the robot from the front.

        Raises:
            InputError: a picture has no such size.
        """
        for name, pixels in (("width", width), ("height", height)):
            if not isinstance(pixels, int | np.integer) or pixels < 1:
                raise InputError(f"{name}: is {pixels!r}, expected a whole number of pixels >= 1")
        self._description = description
        self._view = width, height, camera
        self._renderer: Renderer | None = None

    def draw(self, qpos: FloatArray) -> npt.NDArray[np.uint8]:
        """The picture of a pose (nq,), shape (height, width, 3); of the last one that was finite, if this is not.

        Raises:
            InputError: the model has no such camera.
        """
        if self._renderer is None:
            self._model = build_model(self._description)
            self._data = mujoco.MjData(self._model)
            self._renderer = make_renderer(self._model, *self._view, choice=choose_video_backend())
        update_pose(self._model, self._data, qpos)
        return self._renderer.render(self._data)

    def close(self) -> None:
        """Release the context. May be called twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class Window:
    """`human`: MuJoCo's own window, shown in real time. MuJoCo crashes on a second one in the same process."""

    _latest: ClassVar[NativeViewerSink | None] = None

    def __init__(self, description: RobotDescription, period: float) -> None:
        """Open the window.

        Args:
            description: of the robot.
            period: s between two poses that are shown.

        Raises:
            InputError: no window can be opened here, or another one is open.
        """
        if Window._latest is not None and not Window._latest.closed:
            raise InputError("render_mode: human is shown by another environment of this process; close that one first")
        self._period = period
        self._shown = 0
        self._due = perf_counter()
        try:
            self._viewer = NativeViewerSink(lambda: build_model(description))
        except InputError as error:
            reason = str(error).partition(";")[0].removeprefix("viewer native: ")
            raise InputError(f"render_mode: human cannot be shown here: {reason}; use rgb_array instead") from None
        Window._latest = self._viewer
        self._viewer.start(SessionHeader(description.name, description.joint_names, period, 0))

    def show(self, tick: TickInput, output: TickOutput, qpos: FloatArray) -> None:
        """Show a pose (nq,), when it is due: not before a period has passed since the last one."""
        sleep(max(self._due - perf_counter(), 0.0))
        self._due = max(self._due, perf_counter() - self._period) + self._period
        self._viewer.tick(TickRecord(self._shown, tick, output, 0.0, False, qpos))
        self._shown += 1

    def close(self) -> None:
        """Close the window. May be called twice."""
        self._viewer.close()
