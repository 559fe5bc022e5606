"""Environments that must do the same: many robots and single ones, an original and its copy."""

from typing import Any

import gymnasium
import msgspec
import numpy as np
from gymnasium.vector import SyncVectorEnv
from models import contract_of

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.robots.description import RobotDescription, load_robot

EVERYTHING: dict[str, Any] = {
    "mass": (0.8, 1.2), "centre_of_mass": 0.01, "payload": (0.0, 0.5), "friction": (0.5, 1.2),
    "joint_friction": (0.5, 2.0), "armature": (0.5, 2.0), "gravity_tilt": 0.05,
    "stiffness": (0.9, 1.1), "damping": (0.9, 1.1), "motor_strength": (0.8, 1.1), "effort_limit": (0.8, 1.0),
    "command_delay": (0.0, 0.03), "command_jitter": 0.01, "state_delay": (0.0, 0.03), "joint_position_bias": 0.01,
    "orientation_bias": 0.02, "angular_velocity_bias": 0.02, "linear_acceleration_bias": 0.1,
    "joint_position_noise": 0.005, "joint_velocity_noise": 0.05, "orientation_noise": 0.01,
    "angular_velocity_noise": 0.05, "linear_acceleration_noise": 0.1,
}  # fmt: skip
"""Of the randomisation of any robot."""
PUSHED = EVERYTHING | {"push": (0.1, 0.5), "push_interval": 0.2}
"""That of one whose base is free."""


def hasty(name: str = "lite") -> RobotDescription:
    """A shipped robot that reaches its standby poses in 0.2 s."""
    robot = load_robot(name)
    short = {
        field: msgspec.structs.replace(
            getattr(robot, field), segment_durations=(0.1,) * len(getattr(robot, field).segment_durations)
        )
        for field in ("standby_controller_a", "standby_controller_b")
    }
    return msgspec.structs.replace(robot, **short)


def following(robot: RobotDescription) -> PolicyContract:
    """A contract that follows the pelvis and the joints of a motion, in the robot's order."""
    names = robot.joint_names
    return contract_of(
        names,
        task_type="tracking",
        joint_stiffness=robot.stiffness,
        joint_damping=robot.damping,
        default_joint_pos=robot.initial_position,
        observation=("command", "motion_anchor_pos_b", "motion_anchor_ori_b", "joint_pos", "last_action"),
        command_names=("motion",),
        action_scale=0.25,
        body_names=("pelvis",),
        anchor_body="pelvis",
    )


def both(name: str, count: int, threads: int = 1, **options: Any) -> tuple[Any, SyncVectorEnv]:
    """The environment of many robots, and Gymnasium's own of as many single ones."""
    native = gymnasium.make_vec(name, num_envs=count, threads=threads, **options)
    return native, SyncVectorEnv([lambda: gymnasium.make(name, **options)] * count)


def walk_along(native: Any, sync: SyncVectorEnv, steps: int, reach: float = 0.05) -> list[Any]:
    """Steps of both, with actions up to `reach`, which must be the same; the frames that were shown."""
    ours, theirs = native.reset(seed=3), sync.reset(seed=3)
    np.testing.assert_array_equal(ours[0], theirs[0])
    frames = [ours[1]["frame"]]
    np.testing.assert_array_equal(frames[0], theirs[1]["frame"])
    generator = np.random.default_rng(0)
    for _ in range(steps):
        action = generator.uniform(-reach, reach, native.action_space.shape).astype(np.float32)
        ours, theirs = native.step(action), sync.step(action)
        np.testing.assert_allclose(ours[0], theirs[0], rtol=0, atol=1e-6)
        assert native.observation_space.contains(ours[0])
        np.testing.assert_allclose(ours[1], theirs[1], rtol=0, atol=1e-9)
        for i in (2, 3):
            np.testing.assert_array_equal(ours[i], theirs[i])
        np.testing.assert_array_equal(ours[4]["frame"], theirs[4]["frame"])
        for i, env in enumerate(sync.envs):
            other = env.unwrapped.robot.qpos  # type: ignore[attr-defined]
            np.testing.assert_allclose(native.simulation.qpos[i], other, rtol=0, atol=1e-9)
        frames.append(ours[4]["frame"])
    return frames


def same(one: Any, other: Any) -> None:
    """Everything that a step or a reset gave is the same to the bit."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            same(one[name], other[name])
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            same(a, b)
    else:
        np.testing.assert_array_equal(one, other)
