"""Choice of the OpenGL to draw with on this machine, if any.

Nothing here, nor anything in this package, needs `MUJOCO_GL` to be set before MuJoCo is imported: a context is made
from `mujoco.osmesa`, `mujoco.egl` or `mujoco.glfw` directly, when the first picture is drawn.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from ctypes.util import find_library
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Literal

from humanoid_sim.errors import InputError, MissingPackageError

OpenGL = Literal["glfw", "osmesa", "egl", "none"]

_NAMES: Mapping[OpenGL, tuple[str, ...]] = {
    "glfw": ("glfw", "glx", "cgl", "wgl"),
    "osmesa": ("osmesa",),
    "egl": ("egl",),
    "none": ("disable", "disabled", "off", "false", "0"),
}
_REQUESTS = {request: opengl for opengl, requests in _NAMES.items() for request in requests}
_NO_REQUEST = ("", "enable", "enabled", "on", "true", "1")

_EGL_PROBE = "from mujoco.egl import GLContext; GLContext(16, 16).make_current()"


@dataclass(frozen=True, slots=True)
class Choice:
    """OpenGL to draw with, and the reason."""

    opengl: OpenGL
    reason: str

    def __str__(self) -> str:
        return f"{'no OpenGL' if self.opengl == 'none' else self.opengl} ({self.reason})"


def has_display() -> bool:
    """Return whether a window could be opened: on Linux, an X or Wayland display is named in the environment."""
    return sys.platform in {"darwin", "win32"} or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_environment() -> str:
    """Return what `MUJOCO_GL` asks for, in lower case; empty if it asks for nothing.

    Raises `InputError` for a value that MuJoCo does not know; it would fail at import.
    """
    request = os.environ.get("MUJOCO_GL", "").lower().strip()
    if request not in _REQUESTS and request not in _NO_REQUEST:
        raise InputError(f"environment variable MUJOCO_GL: is '{request}', accepted: glfw, osmesa, egl, disable")
    return request


def choose_backend() -> Choice:
    """Choose the OpenGL to draw with: `MUJOCO_GL`'s, else a display's, else OSMesa, else a working EGL, else none."""
    request = check_environment()
    if request in _REQUESTS:
        return Choice(_REQUESTS[request], f"MUJOCO_GL={request}")
    if has_display():
        return Choice("glfw", "there is a display")
    if find_library("OSMesa"):
        return Choice("osmesa", "no display; libOSMesa is installed")
    if not find_library("EGL"):
        return Choice("none", "no display, no libOSMesa, no libEGL")
    if egl_works():
        return Choice("egl", "no display, no libOSMesa; libEGL works")
    return Choice("none", "no display, no libOSMesa; libEGL is installed but makes no context")


def require_pictures(option: str) -> None:
    """Raise `InputError`, which names the option, where no picture can be drawn or encoded."""
    choice = choose_backend()
    if choice.opengl == "none":
        raise InputError(f"{option}: {choice} here; --html FILE.html shows the run in a browser without")
    if find_spec("av") is None:
        raise MissingPackageError("av", "video", option)


@cache
def egl_works() -> bool:
    """Try EGL in a process of its own: where its driver is missing or broken it may abort instead of raising."""
    try:
        probe = subprocess.run([sys.executable, "-c", _EGL_PROBE], check=False, capture_output=True, timeout=30)
    except (OSError, subprocess.SubprocessError):
        return False
    return probe.returncode == 0
