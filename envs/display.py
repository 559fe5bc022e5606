"""What Gymnasium's render modes show of one robot: pictures, or MuJoCo's own window."""

from __future__ import annotations

from contextlib import ExitStack, closing
from time import perf_counter, sleep
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.pictures import PoseRenderer, check_window, update_pose
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model

RENDER_MODES = ["human", "rgb_array"]
PICTURE = 480, 480  # pixels, width and height


class Display:
    """Shows poses: `rgb_array` draws them, `human` opens a window in which time is real."""

    def __init__(self, description: RobotDescription, period: float, render_mode: str | None) -> None:
        """Prepare; nothing is loaded before the first pose, of which there is one every `period` s."""
        if render_mode not in (None, *RENDER_MODES):
            raise InputError(f"render_mode: is {render_mode!r}, expected {', '.join(RENDER_MODES)} or None")
        if render_mode == "human":
            check_window()
        self._mode, self._period, self._description = render_mode, period, description
        self._open, self._shown = ExitStack(), 0.0
        self._pictures: PoseRenderer | None = None
        self._window: Any = None
        self.metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": round(1.0 / period)}
        """An environment's."""

    def picture(self, qpos: FloatArray) -> npt.NDArray[np.uint8] | None:
        """Return a picture of a pose (nq,), shape (height, width, 3); None unless the mode is `rgb_array`."""
        if self._mode != "rgb_array":
            return None
        if self._pictures is None:
            pictures = PoseRenderer(build_model(self._description), *PICTURE)
            self._pictures = self._open.enter_context(closing(pictures))
        return self._pictures.draw(qpos)

    def show(self, qpos: FloatArray) -> None:
        """Show a pose (nq,) in the window, a period after the last one."""
        if self._mode != "human":
            return
        if self._window is None:
            import mujoco.viewer  # noqa: PLC0415 - loads GLFW

            self._model = build_model(self._description)
            self._data = mujoco.MjData(self._model)
            window = mujoco.viewer.launch_passive(self._model, self._data, show_left_ui=False, show_right_ui=False)
            self._window = self._open.enter_context(window)
        sleep(max(self._shown + self._period - perf_counter(), 0.0))
        self._shown = perf_counter()
        with self._window.lock():
            update_pose(self._model, self._data, qpos)
        self._window.sync()

    def close(self) -> None:
        """Close window and contexts. May be called twice."""
        self._open.close()
        self._pictures = self._window = None
