"""Pictures of a simulated robot: page, video, window."""

import importlib
import os

from humanoid_sim.errors import InputError, reason_of


def check_environment() -> None:
    """Raise `InputError` for a `MUJOCO_GL` with which MuJoCo cannot be imported."""
    try:
        importlib.import_module("mujoco.rendering.classic.gl_context")
    except Exception as error:  # drivers raise anything
        name = os.environ.get("MUJOCO_GL", "")
        accepted = f"expected glfw, osmesa, egl or disable: {reason_of(error)}"
        raise InputError(f"environment variable MUJOCO_GL: is '{name}', {accepted}") from None
