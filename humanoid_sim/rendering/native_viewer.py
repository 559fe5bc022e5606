"""MuJoCo's own window, in a process of its own."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco

from humanoid_sim.errors import InputError
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.rendering.camera import make_camera


@contextmanager
def open_window(model: mujoco.MjModel, data: mujoco.MjData, *, sliders: bool = False) -> Iterator[Any]:
    """MuJoCo's window (`mujoco.viewer.launch_passive`), seen by the camera that videos have.

    `data` has its pose computed. With `sliders` the panel is open that has one for each joint.
    """
    import mujoco.viewer  # noqa: PLC0415 - loads GLFW, which only a machine with a display has

    camera = make_camera(model)
    with mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=sliders) as window:
        with window.lock():
            for name in ("type", "trackbodyid", "lookat", "distance", "azimuth", "elevation"):
                setattr(window.cam, name, getattr(camera, name))
        yield window


def check_window() -> None:
    """Raise `InputError` if no window can be opened: a display may be named and not answer."""
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
