"""What Gymnasium's render modes show of one robot: pictures, or MuJoCo's own window."""

from __future__ import annotations

from time import perf_counter, sleep
from typing import Any, ClassVar

import mujoco
import mujoco.viewer
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.pictures import PoseRenderer, has_display
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model

RENDER_MODES = ["human", "rgb_array"]
PICTURE = 480, 480  # pixels, width and height


class Display:
    """Shows poses: `rgb_array` draws them, `human` opens a window in which time is real."""

    _open: ClassVar[Display | None] = None
    """MuJoCo crashes on a second window in the same process."""

    def __init__(self, description: RobotDescription, period: float, render_mode: str | None) -> None:
        """Prepare; nothing is loaded before the first pose, of which there is one every `period` s.

        Raises `InputError` if there is no such mode, or no window can be opened.
        """
        if render_mode not in (None, *RENDER_MODES):
            raise InputError(f"render_mode: is {render_mode!r}, expected {', '.join(RENDER_MODES)} or None")
        if render_mode == "human" and not has_display():
            raise InputError("render_mode: human needs a display; use rgb_array instead")
        self._mode, self._period, self._description = render_mode, period, description
        self._pictures = PoseRenderer(lambda: build_model(description), *PICTURE)
        self._viewer: Any = None
        self._due = 0.0
        modes = [mode for mode in RENDER_MODES if mode != "human" or has_display()]
        self.metadata: dict[str, Any] = {"render_modes": modes, "render_fps": round(1.0 / period)}
        """An environment's; without a display no window opens."""

    def picture(self, qpos: FloatArray) -> npt.NDArray[np.uint8] | None:
        """Return a picture of a pose (nq,), shape (height, width, 3); None unless the mode is `rgb_array`."""
        return self._pictures.draw(qpos) if self._mode == "rgb_array" else None

    def show(self, qpos: FloatArray) -> None:
        """Show a pose (nq,) in the window, a period after the last one."""
        if self._mode != "human":
            return
        if self._viewer is None:
            if Display._open is not None:
                raise InputError("render_mode: human is shown by another environment of this process; close it first")
            self._model = build_model(self._description)
            self._data = mujoco.MjData(self._model)
            self._viewer = mujoco.viewer.launch_passive(self._model, self._data)
            Display._open = self
        sleep(max(self._due - perf_counter(), 0.0))
        self._due = max(self._due, perf_counter() - self._period) + self._period
        with self._viewer.lock():
            self._data.qpos[:] = qpos
            mujoco.mj_kinematics(self._model, self._data)
        self._viewer.sync()

    def close(self) -> None:
        """Close window and contexts. May be called twice."""
        self._pictures.close()
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = Display._open = None
