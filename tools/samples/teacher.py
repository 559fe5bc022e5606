"""Knowledge that the policy does not have: the command that follows a motion exactly, by inverse dynamics.

Under the MIT law with position commands only, `K_p (u - q) - K_d qd = M qdd + bias + friction`. The joints follow a
motion q(t) exactly if

    u* = q + (K_d qd + M qdd + bias + friction) / K_p

held over a policy step and taken in the middle of it. The policy sees one frame of the motion, neither its velocity nor
its future; training (`closed_loop.py`) makes it find what of u* can be known from that frame, the joints and its own
last action.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.mit import FloatArray
from tools.samples.arm import ARM_JOINTS, ArmModel
from tools.samples.motions import derivative
from tools.samples.random_motions import PERIOD

__all__ = [
    "Plants",
    "TrainingMotions",
    "TrainingPoses",
    "error_weight",
    "exact_command",
    "training_motions",
    "training_poses",
]

_UNITS = np.array([[0.03] * 3 + [0.20] * 3, [0.01] * 3 + [0.08] * 3])
"""m and rad, shape (2, 6), elbow and hand: errors of the same cost. The elbow settles what the hands leave open."""
_JOINT_UNIT = 0.33
"""rad: a little cost on the joints themselves, where a singular pose lets them move unseen."""
_FRICTION_SPEED = 0.03
"""rad/s over which Coulomb friction changes its sign."""


@dataclass(frozen=True, slots=True, eq=False)
class Plants:
    """Robots that differ from the description: what the policy must put up with. N of them, one per motion."""

    stiffness: FloatArray
    """Shape (N, 7), N·m/rad: what the motors make of the commanded K_p."""
    damping: FloatArray
    """Shape (N, 7), N·m·s/rad."""
    inertia: FloatArray
    """Shape (N,), a factor on mass matrix and gravity."""

    @classmethod
    def sample(cls, arm: ArmModel, rng: np.random.Generator, count: int) -> Plants:
        """Gains within 12 %, inertia within 10 % of the description's."""
        shape = (count, ARM_JOINTS)
        return cls(
            stiffness=arm.stiffness * rng.uniform(0.88, 1.12, shape),
            damping=arm.damping * rng.uniform(0.88, 1.12, shape),
            inertia=rng.uniform(0.9, 1.1, count),
        )


@dataclass(frozen=True, slots=True, eq=False)
class TrainingMotions:
    """N motions of T policy steps. Where it says middle, values are those half a policy step after the frame."""

    joint_position: FloatArray
    """Shape (N, T, 7), rad."""
    joint_velocity: FloatArray
    """Shape (N, T, 7), rad/s."""
    body_position: FloatArray
    """Shape (N, T, 2, 3), m, base frame: elbow and hand."""
    body_rotation: FloatArray
    """Shape (N, T, 2, 3, 3), base frame."""
    weight: FloatArray
    """Shape (N, T, 7, 7), 1/rad²: see `error_weight`."""
    command: FloatArray
    """Shape (N, T, 7), rad: u* in the middle, on the motion's own plant."""
    sag: FloatArray
    """Shape (N, T, 7), rad: how far gravity pulls the joints below a held command, on that plant; in the middle."""
    mass: FloatArray
    """Shape (N, T, 7, 7), kg·m², in the middle."""
    plants: Plants


@dataclass(frozen=True, slots=True, eq=False)
class TrainingPoses:
    """N poses at rest, to learn the geometry and the hold against gravity from."""

    joint_position: FloatArray
    """Shape (N, 7), rad."""
    body_position: FloatArray
    """Shape (N, 2, 3), m, base frame."""
    body_rotation: FloatArray
    """Shape (N, 2, 3, 3), base frame."""
    weight: FloatArray
    """Shape (N, 7, 7), 1/rad²."""
    sag: FloatArray
    """Shape (N, 7), rad."""


def error_weight(jacobian: FloatArray) -> FloatArray:
    """W such that `e W e` is what a joint error e costs: the mean square of the body errors it makes, in their units.

    Args:
        jacobian: shape (..., 2, 6, 7), as `ArmModel.jacobians` gives it.

    Returns:
        Shape (..., 7, 7), 1/rad².
    """
    scaled = (jacobian / _UNITS[..., None]).reshape(*jacobian.shape[:-3], 12, ARM_JOINTS)
    bodies: FloatArray = np.swapaxes(scaled, -1, -2) @ scaled / 12.0
    return bodies + np.eye(ARM_JOINTS) / _JOINT_UNIT**2


def exact_command(
    arm: ArmModel,
    position: FloatArray,
    velocity: FloatArray,
    inertial_torque: FloatArray,
    stiffness: FloatArray,
    damping: FloatArray,
) -> FloatArray:
    """u* of the module's docstring; all arrays (..., 7), in rad, rad/s, N·m (mass and bias), N·m/rad, N·m·s/rad."""
    friction = arm.friction * np.tanh(velocity / _FRICTION_SPEED)
    command: FloatArray = position + (damping * velocity + inertial_torque + friction) / stiffness
    return command


def training_motions(arm: ArmModel, paths: Sequence[FloatArray], rng: np.random.Generator) -> TrainingMotions:
    """Return what training needs of the motions (F, 7), rad, sampled every `PERIOD`; each gets a plant of its own."""
    path = np.stack(paths)
    velocity = np.stack([derivative(p, PERIOD) for p in path])
    acceleration = np.stack([derivative(v, PERIOD) for v in velocity])
    shape = path[:, ::2].shape
    frame, middle = path[:, ::2].reshape(-1, ARM_JOINTS), path[:, 1::2].reshape(-1, ARM_JOINTS)
    body_position, body_rotation = arm.poses(frame)
    mass, bias = arm.dynamics(middle, velocity[:, 1::2].reshape(-1, ARM_JOINTS))

    plants = Plants.sample(arm, rng, len(path))
    stiffness, damping = plants.stiffness[:, None], plants.damping[:, None]
    mass = mass.reshape(*shape, ARM_JOINTS) * plants.inertia[:, None, None, None]
    bias = bias.reshape(shape) * plants.inertia[:, None, None]
    torque = (mass @ acceleration[:, 1::2, :, None])[..., 0] + bias
    return TrainingMotions(
        joint_position=path[:, ::2],
        joint_velocity=velocity[:, ::2],
        body_position=body_position.reshape(*shape[:2], 2, 3),
        body_rotation=body_rotation.reshape(*shape[:2], 2, 3, 3),
        weight=error_weight(arm.jacobians(frame)).reshape(*shape, ARM_JOINTS),
        command=exact_command(arm, path[:, 1::2], velocity[:, 1::2], torque, stiffness, damping),
        sag=bias / stiffness,
        mass=mass,
        plants=plants,
    )


def training_poses(arm: ArmModel, count: int, rng: np.random.Generator) -> TrainingPoses:
    """Random poses without collision, from all over the workspace."""
    q = np.stack([arm.sample(rng, near_home=0.3) for _ in range(count)])
    position, rotation = arm.poses(q)
    _, gravity = arm.dynamics(q, np.zeros_like(q))
    return TrainingPoses(q, position, rotation, error_weight(arm.jacobians(q)), gravity / arm.stiffness)
