"""Environments that must do the same, many robots and single ones; robots for tests."""

from typing import Any

import gymnasium
import msgspec
import numpy as np
from gymnasium.vector import SyncVectorEnv

from humanoid_sim.robots.description import RobotDescription, load_robot

LITE, BIPED, PIANO = (f"humanoid_sim/{name}-v0" for name in ("LiteTracking", "BipedVelocity", "LitePiano"))
EVERYTHING: dict[str, Any] = {
    **{"mass": (0.8, 1.2), "centre_of_mass": 0.01, "friction": (0.5, 1.2), "armature": (0.5, 2.0)},
    **{"gains": (0.9, 1.1), "effort": (0.8, 1.0), "delay": (0.0, 0.03), "encoder_offset": 0.01},
}
PUSHED = EVERYTHING | {"push": (0.1, 0.5), "push_interval": 0.2}
"""Of a robot whose base floats."""
STILL = {"joint_noise": 0.0, "velocity_noise": 0.0}


def hasty(name: str = "lite") -> RobotDescription:
    """A shipped robot that reaches its standby poses in 0.2 s."""
    robot = load_robot(name)
    standby = {
        field: msgspec.structs.replace(
            getattr(robot, field), segment_durations=(0.1,) * len(getattr(robot, field).segment_durations)
        )
        for field in ("standby_controller_a", "standby_controller_b")
    }
    return msgspec.structs.replace(robot, **standby)


def both(name: str, count: int, **options: Any) -> tuple[Any, SyncVectorEnv]:
    """The environment of many robots, and Gymnasium's own of as many single ones."""
    native = gymnasium.make_vec(name, num_envs=count, threads=1, **options)
    return native, SyncVectorEnv([lambda: gymnasium.make(name, **options)] * count)


def walk_along(native: Any, sync: SyncVectorEnv, steps: int, reach: float = 0.05, seed: Any = 3) -> None:
    """Steps of both, with actions up to `reach`, which must be the same."""
    ours, theirs = native.reset(seed=seed), sync.reset(seed=seed)
    np.testing.assert_array_equal(ours[0], theirs[0])
    generator = np.random.default_rng(0)
    for _ in range(steps):
        action = generator.uniform(-reach, reach, native.action_space.shape).astype(np.float32)
        ours, theirs = native.step(action), sync.step(action)
        np.testing.assert_allclose(ours[0], theirs[0], rtol=0, atol=1e-6)
        np.testing.assert_allclose(ours[1], theirs[1], rtol=0, atol=1e-9)
        np.testing.assert_array_equal(ours[2:4], theirs[2:4])
        same_info(ours[4], theirs[4])
        for i, env in enumerate(sync.envs):
            other = env.unwrapped.robot.qpos  # type: ignore[attr-defined]
            np.testing.assert_allclose(native.simulation.qpos[i], other, rtol=0, atol=1e-9)


def same_info(ours: Any, theirs: Any) -> None:
    """Each environment has the same entries: what a mask does not name is nobody's."""
    assert ours.keys() == theirs.keys()
    for key in ours:
        if key.startswith("_"):
            np.testing.assert_array_equal(ours[key], theirs[key])
        elif isinstance(ours[key], dict):
            same_info(ours[key], theirs[key])
        else:
            for i in np.flatnonzero(ours[f"_{key}"]):
                if isinstance(ours[key][i], str):
                    assert ours[key][i][:19] == theirs[key][i][:19]
                else:
                    np.testing.assert_allclose(ours[key][i], theirs[key][i], rtol=0, atol=1e-6)
