"""Walk at a commanded velocity with a gait: feet that swing and stand as the contract's clock says."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.envs.tasks.task import BoolArray
from humanoid_sim.envs.tasks.velocity import VelocityTask
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.errors import total
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import FloatArray, point_velocity
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses

_LINEAR_SCALES = 0.15, 0.5
"""m/s: a sharp one to hold a speed by, and a wide one to find it."""
_YAW_SCALES = 0.2, 0.8
"""rad/s"""
_LIFT = 0.06
"""m by which a foot is lifted in the middle of its swing."""
_LIFT_SCALE = 0.03
"""m"""
_NEAR = 0.02
"""m above the floor over which a foot's speed ceases to count as sliding or slapping."""
_SPARE_EFFORT = 0.8
"""Share of a joint's effort limit from which on its torque costs."""
_ABSENT = 0.25
"""Share of the commands in which a component is zero."""
_STANDING = 0.25
"""Share of the commands that are zero altogether."""


class WalkingTask(VelocityTask):
    """`VelocityTask` with a gait.

    The clock's phase tells which of two feet swings: the left one while its sine is positive, the right one while it
    is negative; while the command is to stand, neither does.

    ================= ====== ======= ===============================================================================
    term              weight unit    value
    ================= ====== ======= ===============================================================================
    linear_velocity   4.0    1       mean of exp(-e²/s²) for s = 0.15 and 0.5 m/s, e the horizontal velocity error in
                                     the heading frame
    yaw_rate          2.0    1       likewise for 0.2 and 0.8 rad/s, e the error of the rate about the vertical
    foot_height       1.5    1       exp(-e²/0.03² m²), e of a foot's height from 0.06 m · sine in its swing and from
                                     the floor otherwise, mean over the feet
    foot_slide        -2.0   m²/s²   squared horizontal speed of the feet, faded out over 0.02 m of height
    foot_slap         -1.0   m²/s²   squared downward speed of the feet, faded out likewise
    foot_tilt         -1.0   1       squared sine of the feet's tilt, summed
    upright           -3.0   1       squared sine of the angle between the base's z axis and the vertical
    height            -20.0  m²      squared difference of the base's height from where it stands, beyond 0.02 m
    vertical_velocity -0.5   m²/s²   squared vertical velocity of the base
    rocking           -0.1   rad²/s² squared angular velocity of the base about its x and y axes
    posture           -0.3   rad²    squared distance of the joints that neither step nor bend from the default pose
    stillness         -0.02  rad²/s² squared joint velocities while the command is to stand
    strain            -1.0   1       squared torque beyond 0.8 of the joint's limit, as a share of it, summed
    alive             0.5    1       1
    ================= ====== ======= ===============================================================================

    Commands hold for 5 s; a quarter are zero, and of the others each component is with a probability of 25 %.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType(
        {
            **VelocityTask.WEIGHTS,
            "linear_velocity": 4.0,
            "yaw_rate": 2.0,
            "foot_height": 1.5,
            "foot_slide": -2.0,
            "foot_slap": -1.0,
            "foot_tilt": -1.0,
            "upright": -3.0,
            "height": -20.0,
            "vertical_velocity": -0.5,
            "rocking": -0.1,
            "posture": -0.3,
            "stillness": -0.02,
            "strain": -1.0,
        }
    )

    def __init__(
        self, description: RobotDescription, contract: PolicyContract, reference: MotionReference, **options: Any
    ) -> None:
        """As `VelocityTask`, for a robot whose `hands` are its two feet, the left one first.

        Raises:
            InputError: the base is fixed, the contract has no clock, or the robot has not two feet with a site each.
        """
        super().__init__(description, contract, reference, **options)
        if contract.phase is None:
            raise InputError("task: walking needs a contract with a phase, the gait's clock, and this one has none")
        if len(description.hands) != 2:
            raise InputError(
                f"task: walking needs two feet, the `hands` of the robot: {description.name} has "
                f"{len(description.hands)}"
            )
        self.bodies = tuple(description.hands)
        self._measure_feet(description)
        self._stays = np.array(
            [1.0 if any(part in name for part in ("yaw", "roll")) else 0.0 for name in description.joint_names]
        )

    def _measure_feet(self, description: RobotDescription) -> None:
        """Heights of base and feet, and which of their axes points up, where the robot stands."""
        import mujoco  # noqa: PLC0415 - most tasks need no model

        model = build_model(description, scene=False)
        data = mujoco.MjData(model)
        data.qpos[joint_addresses(model, description.joint_names).qpos] = self._pose
        mujoco.mj_kinematics(model, data)
        base = data.body(description.base.body)
        feet = [data.body(name) for name in self.bodies]
        self._foot_up = np.array([foot.xmat.reshape(3, 3).T @ np.array([0.0, 0.0, 1.0]) for foot in feet])
        soles = []
        for name, foot in zip(self.bodies, feet, strict=True):
            geoms = [
                g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body(name).id and model.geom_contype[g]
            ]
            lowest = [
                data.geom_xpos[g][2] - np.abs(data.geom_xmat[g].reshape(3, 3)[2]) @ model.geom_size[g] for g in geoms
            ]
            soles.append(foot.xpos[2] - min(lowest))
        self._sole = np.array(soles)
        self._base_height = float(base.xpos[2] - np.mean([foot.xpos[2] for foot in feet]) + np.mean(self._sole))

    def _commands(self, numbers: FloatArray) -> FloatArray:
        drawn = numbers.reshape(*numbers.shape[:-1], self._command_count, 4)
        share = drawn[..., :3]
        moving = np.clip((share - _ABSENT) / (1.0 - _ABSENT), 0.0, 1.0)
        command = np.where(share < _ABSENT, 0.0, self._low + self._width * moving)
        return np.where(drawn[..., 3:] < _STANDING, 0.0, command)

    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        values, failed = super()._measure(sample)
        base, phase = sample.base, sample.phase
        assert base is not None
        assert phase is not None
        error = base.planar_velocity - sample.command
        velocity, turning = error[..., :2], error[..., 2]
        feet = slice(-len(self.bodies), None)
        position = rotate(base.quaternion[..., None, :], sample.body_position[..., feet, :])
        up = rotate(base.quaternion[..., None, :], rotate(sample.body_quaternion[..., feet, :], self._foot_up))
        height = position[..., 2] + base.height[..., None] - self._sole
        speed = np.stack([sample.state.extern[point_velocity(foot)].value for foot in self.bodies], axis=-2)
        stands = np.isnan(phase[..., :1]) | (sample.command == 0.0).all(axis=-1, keepdims=True)
        swing = np.maximum(np.where(stands, 0.0, np.sin(phase[..., :1]) * np.array([1.0, -1.0])), 0.0)
        lag = height - _LIFT * swing
        near = np.exp(np.maximum(height, 0.0) / -_NEAR)
        slide = total(speed[..., :2] * speed[..., :2])
        slap = np.minimum(speed[..., 2], 0.0) ** 2
        sunk = np.maximum(np.abs(base.height - self._base_height) - 0.02, 0.0)
        away = sample.state.joint_position - self._pose
        moving = sample.state.joint_velocity
        beyond = np.maximum(np.abs(sample.torque) * self._inverse_effort - _SPARE_EFFORT, 0.0)
        values |= {
            "linear_velocity": _closeness(total(velocity * velocity), _LINEAR_SCALES),
            "yaw_rate": _closeness(turning * turning, _YAW_SCALES),
            "foot_height": np.mean(np.exp(lag * lag / -(_LIFT_SCALE**2)), axis=-1),
            "foot_slide": total(slide * near),
            "foot_slap": total(slap * near),
            "foot_tilt": total(up[..., 0] ** 2 + up[..., 1] ** 2),
            "height": sunk * sunk,
            "posture": total(self._stays * away * away),
            "stillness": np.where(stands[..., 0], total(moving * moving), 0.0),
            "strain": total(beyond * beyond),
        }
        return values, failed


def _closeness(squared: FloatArray, scales: tuple[float, float]) -> FloatArray:
    """1 without an error, shape (...): the mean over two scales, of squared errors."""
    sharp, wide = scales
    closeness: FloatArray = 0.5 * (np.exp(squared / -(sharp**2)) + np.exp(squared / -(wide**2)))
    return closeness
