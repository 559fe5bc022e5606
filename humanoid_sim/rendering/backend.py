"""Choice of the OpenGL to draw with on this machine, if any.

Nothing here, nor anything in this package, needs `MUJOCO_GL` to be set before MuJoCo is imported: a context is made
from `mujoco.osmesa`, `mujoco.egl` or `mujoco.glfw` directly, when the first picture is drawn.
"""

from __future__ import annotations

import ctypes.util
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Literal

from humanoid_sim.errors import InputError

OpenGL = Literal["glfw", "osmesa", "egl", "none"]

_WINDOW: OpenGL = "glfw"
_NOTHING: OpenGL = "none"
_REQUESTS: Mapping[str, OpenGL] = {
    **dict.fromkeys(("glfw", "glx", "cgl", "wgl"), _WINDOW),
    "osmesa": "osmesa",
    "egl": "egl",
    **dict.fromkeys(("disable", "disabled", "off", "false", "0"), _NOTHING),
}
_NO_REQUEST = ("", "enable", "enabled", "on", "true", "1")

_EGL_PROBE = "from mujoco.egl import GLContext; GLContext(16, 16).make_current()"


@dataclass(frozen=True, slots=True)
class Choice:
    """OpenGL to draw with, and the reason."""

    opengl: OpenGL
    """`none`: the software painter."""
    reason: str

    def __str__(self) -> str:
        return f"{'software painter' if self.opengl == 'none' else self.opengl} ({self.reason})"


def has_display(environ: Mapping[str, str] | None = None, platform: str = sys.platform) -> bool:
    """Return whether a window could be opened: on Linux, an X or Wayland display is named in the environment."""
    environ = os.environ if environ is None else environ
    return platform in {"darwin", "win32"} or bool(environ.get("DISPLAY") or environ.get("WAYLAND_DISPLAY"))


def check_environment(environ: Mapping[str, str] | None = None) -> str:
    """Return what `MUJOCO_GL` asks for, in lower case; empty if it asks for nothing.

    Raises `InputError` for a value that MuJoCo does not know; it would fail at import.
    """
    request = (os.environ if environ is None else environ).get("MUJOCO_GL", "").lower().strip()
    if request not in _REQUESTS and request not in _NO_REQUEST:
        raise InputError(f"environment variable MUJOCO_GL: is '{request}', accepted: glfw, osmesa, egl, disable")
    return request


def choose_backend(
    environ: Mapping[str, str] | None = None,
    *,
    platform: str = sys.platform,
    find_library: Callable[[str], str | None] = ctypes.util.find_library,
    try_egl: Callable[[], bool] | None = None,
) -> Choice:
    """Choose the OpenGL to draw with: `MUJOCO_GL`'s, else a display's, else OSMesa, else a working EGL, else none.

    Everything that the answer depends on can be given: `environ` (default: the process's), the platform, the search
    for a shared library, and the trial of EGL.
    """
    environ = os.environ if environ is None else environ
    request = check_environment(environ)
    if request in _REQUESTS:
        return Choice(_REQUESTS[request], f"MUJOCO_GL={request}")
    if has_display(environ, platform):
        return Choice("glfw", "there is a display")
    if find_library("OSMesa"):
        return Choice("osmesa", "no display; libOSMesa is installed")
    if not find_library("EGL"):
        return Choice("none", "no display, no libOSMesa, no libEGL")
    if (try_egl or egl_works)():
        return Choice("egl", "no display, no libOSMesa; libEGL works")
    return Choice("none", "no display, no libOSMesa; libEGL is installed but makes no context")


@cache
def egl_works() -> bool:
    """Try EGL in a process of its own: where its driver is missing or broken it may abort instead of raising."""
    try:
        probe = subprocess.run([sys.executable, "-c", _EGL_PROBE], check=False, capture_output=True, timeout=30)
    except (OSError, subprocess.SubprocessError):
        return False
    return probe.returncode == 0
