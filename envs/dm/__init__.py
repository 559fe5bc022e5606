"""The tasks as `dm_env` environments, through `dm_control`: `load("lite_tracking")`. Needs the extra `dm`."""

from __future__ import annotations

import importlib
import os
from functools import partial
from typing import TYPE_CHECKING, Any

from humanoid_sim.envs.registration import ENVIRONMENTS
from humanoid_sim.errors import InputError, needing, require_known
from humanoid_sim.rendering.backend import choose_backend

if TYPE_CHECKING:
    from dm_control.rl import control

NAMES = {
    "lite_tracking": "humanoid_sim/LiteTracking-v0",
    "biped_velocity": "humanoid_sim/BipedVelocity-v0",
    "lite_piano": "humanoid_sim/LitePiano-v0",
    "policy": "humanoid_sim/Policy-v0",
}
"""Names of tasks, and the Gymnasium environments that are the same."""


def load(
    name: str,
    *,
    seed: int | None = None,
    time_limit: float = float("inf"),
    flat_observation: bool = False,
    **options: Any,
) -> control.Environment:
    """Return a task as a `dm_control.rl.control.Environment`, which `dm_control.viewer.launch` opens too.

    Args:
        seed: of the starts; the same seed gives the same episodes, and those of the Gymnasium environment. None: any.
        time_limit: s after which an episode ends, if the task does not end it before.
        flat_observation: one array in the order in which the policy sees it, instead of one per term.
        options: as `PolicyEnv` takes them; `policy` needs `contract` and `robot`.

    Raises:
        InputError: there is no such task, or an option is not accepted.
        MissingPackageError: `dm_control` is not installed.
    """
    require_known("dm_env task", [name], NAMES)
    with needing("dm-control", "dm", "humanoid_sim.envs.dm"):
        import dm_control.rl.control  # noqa: F401, PLC0415 - the rest of the package does without

    _settle_opengl()
    from humanoid_sim.envs.dm.task import PolicyTask, TaskEnvironment  # noqa: PLC0415
    from humanoid_sim.envs.policy_env import PolicyEnv  # noqa: PLC0415

    env = PolicyEnv(**{**ENVIRONMENTS[NAMES[name]].get("kwargs", {}), **options})
    kept: dict[str, Any] = {"time_limit": time_limit, "flat_observation": flat_observation}
    return TaskEnvironment(partial(load, name, **kept, **options), PolicyTask(env, seed), **kept)


def _settle_opengl() -> None:
    """Import `dm_control` with an OpenGL that this machine has, or with none: only pictures need it.

    By itself it chooses when it is imported: without a display a GLFW that cannot draw, or a PyOpenGL that fails to
    load without its library. Raises `InputError` if what `MUJOCO_GL` asks for cannot be loaded.
    """
    request, choice = os.environ.get("MUJOCO_GL"), choose_backend()
    os.environ["MUJOCO_GL"] = "disable" if choice.opengl == "none" else choice.opengl
    try:
        importlib.import_module("dm_control.mujoco")
    except (AttributeError, ImportError, RuntimeError) as error:  # what PyOpenGL, GLFW and dm_control raise
        raise InputError(f"dm_control cannot load {choice}: {error}; MUJOCO_GL=disable does without") from None
    finally:
        if request is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = request
