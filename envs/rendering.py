"""Gymnasium's render modes: pictures without a window, and MuJoCo's own window."""

from __future__ import annotations

from time import perf_counter, sleep
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.envs.base import CopyableEnv
from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.rendering.native_viewer import NativeViewerSink
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.terrain import Terrain

RENDER_MODES = ["human", "rgb_array"]


def available_render_modes() -> list[str]:
    """Return the render modes that this machine can show: without a display no window opens."""
    return [mode for mode in RENDER_MODES if mode != "human" or has_display()]


def make_pictures(
    description: RobotDescription, width: int, height: int, camera: str | None, terrain: Terrain | None = None
) -> PoseRenderer:
    """Return what draws pictures of a robot for `rgb_array`, with a model of their own.

    Raises `InputError` if a picture has no such size.
    """
    for name, pixels in (("width", width), ("height", height)):
        if not isinstance(pixels, int | np.integer) or pixels < 1:
            raise InputError(f"{name}: is {pixels!r}, expected a whole number of pixels >= 1")
    return PoseRenderer(lambda: build_model(description, terrain=terrain), width, height, camera, fastest=True)


class Window:
    """`human`: MuJoCo's own window, shown in real time. MuJoCo crashes on a second one in the same process."""

    _latest: ClassVar[NativeViewerSink | None] = None

    def __init__(self, description: RobotDescription, period: float, terrain: Terrain | None = None) -> None:
        """Open the window. Raises `InputError` if no window can be opened here, or another one is open."""
        if Window._latest is not None and not Window._latest.closed:
            raise InputError("render_mode: human is shown by another environment of this process; close that one first")
        self._period = period
        self._shown = 0
        self._due = perf_counter()
        try:
            self._viewer = NativeViewerSink(lambda: build_model(description, terrain=terrain))
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


class ShownEnv(CopyableEnv):
    """Base of environments of one robot, which Gymnasium's render modes show."""

    robot: Any
    _window: Window | None = None

    def _prepare_pictures(
        self,
        description: RobotDescription,
        period: float,
        render_mode: str | None,
        pictures: tuple[int, int, str | None],
        terrain: Terrain | None = None,
    ) -> None:
        """Prepare what is shown. Raises `InputError` if the mode is unknown, or the size of a picture is not possible.

        Args:
            period: s between two poses.
            pictures: width and height in pixels, and the camera of the model; None looks at the robot from the front.
        """
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise InputError(f"render_mode: is {render_mode!r}, expected {', '.join(RENDER_MODES)} or None")
        self.metadata = {"render_modes": available_render_modes(), "render_fps": round(1.0 / period)}
        self.render_mode = render_mode
        self._pictures = make_pictures(description, *pictures, terrain)
        self._shown = description, period, terrain

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the picture, shape (height, width, 3), in the mode `rgb_array`; the window of `human` shows itself."""
        return self._pictures.draw(self.robot.qpos) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close windows and contexts. May be called twice."""
        self._pictures.close()
        if self._window is not None:
            self._window.close()
            self._window = None
        self.robot.close()

    def _show(self, tick: TickInput, output: TickOutput) -> None:
        if self.render_mode == "human":
            if self._window is None:
                self._window = Window(*self._shown)
            self._window.show(tick, output, self.robot.qpos)
