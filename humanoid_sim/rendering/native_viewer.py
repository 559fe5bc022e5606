"""MuJoCo's own window, in a process of its own."""

from __future__ import annotations

import warnings
from typing import Any

import mujoco

from humanoid_sim.errors import InputError
from humanoid_sim.rendering.pictures import has_display


def open_window(model: mujoco.MjModel, data: mujoco.MjData, *, sliders: bool = False) -> Any:
    """Open MuJoCo's window, a context manager; with `sliders`, the panel that has one for each joint."""
    import mujoco.viewer  # noqa: PLC0415 - loads GLFW, which only a machine with a display has

    return mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=sliders)


def check_window() -> None:
    """Raise `InputError` if no window can be opened."""
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
