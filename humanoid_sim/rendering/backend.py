"""Choice of the OpenGL to draw with on this machine, if any.

`MUJOCO_GL` need not be set before MuJoCo is imported: the choice is made when the first picture is drawn.
"""

from __future__ import annotations

import os
import subprocess
import sys
from ctypes.util import find_library
from functools import cache
from importlib.util import find_spec
from typing import Literal

from humanoid_sim.errors import InputError, MissingPackageError

OpenGL = Literal["glfw", "osmesa", "egl", "none"]

_REQUESTS: dict[str, OpenGL] = {
    **dict.fromkeys(("glfw", "glx", "cgl", "wgl"), "glfw"),
    **dict.fromkeys(("disable", "disabled", "off", "false", "0"), "none"),
    "osmesa": "osmesa",
    "egl": "egl",
}
_NO_REQUEST = ("", "enable", "enabled", "on", "true", "1")


def has_display() -> bool:
    """Return True if a window could be opened: on Linux, if the environment names an X or Wayland display."""
    return sys.platform in {"darwin", "win32"} or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_environment() -> str:
    """Return the value of `MUJOCO_GL`. Raises `InputError` for one with which importing MuJoCo fails."""
    request = os.environ.get("MUJOCO_GL", "").lower().strip()
    if request not in _REQUESTS and request not in _NO_REQUEST:
        raise InputError(f"environment variable MUJOCO_GL: is '{request}', accepted: glfw, osmesa, egl, disable")
    return request


def choose_opengl() -> OpenGL:
    """Choose the OpenGL to draw with: `MUJOCO_GL`'s, else a display's, else OSMesa, else a working EGL, else none."""
    request = check_environment()
    if request in _REQUESTS:
        return _REQUESTS[request]
    if has_display():
        return "glfw"
    if find_library("OSMesa"):
        return "osmesa"
    return "egl" if find_library("EGL") and egl_works() else "none"


@cache
def egl_works() -> bool:
    """Try EGL in a process of its own: where its driver is missing or broken it may abort instead of raising."""
    probe = "from mujoco.egl import GLContext; GLContext(16, 16).make_current()"
    try:
        subprocess.run([sys.executable, "-c", probe], check=True, capture_output=True, timeout=30)
    except (OSError, subprocess.SubprocessError):
        return False
    return True


def require_pictures(option: str) -> None:
    """Raise `InputError`, which names the option, where no picture can be drawn or encoded."""
    if choose_opengl() == "none":
        raise InputError(f"{option}: no OpenGL here; --html FILE.html shows the run in a browser without")
    if find_spec("av") is None:
        raise MissingPackageError("av", "video", option)
