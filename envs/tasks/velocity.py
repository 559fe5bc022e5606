"""Walk at a commanded velocity without falling, or with a gait: feet that swing and stand by a clock."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.envs.tasks.task import BoolArray, Task
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.errors import total
from humanoid_sim.evaluation.step import StepSample
from humanoid_sim.mit import FloatArray, point_velocity
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses

_LINEAR_SCALE = 0.25
"""m/s"""
_YAW_SCALE = 0.5
"""rad/s"""
_STANDING = 0.1
"""Share of the commands that are zero."""
_COMMAND_SECONDS = 5.0
"""s that a command holds."""
_RANGES = np.array([[-1.0, 1.0], [-0.5, 0.5], [-1.0, 1.0]])
"""m/s, m/s and rad/s: the commands of a contract that gives no ranges."""

# For a gait:
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
_STANDS = 0.25
"""Share of the commands that are zero altogether."""


class VelocityTask(Task):
    """Move the base at the commanded velocity, upright, for as long as the episode lasts.

    ================= ====== ======= ===============================================================================
    term              weight unit    value
    ================= ====== ======= ===============================================================================
    linear_velocity   1.0    1       exp(-e²/0.25² m²/s²), e the horizontal velocity error in the heading frame, m/s
    yaw_rate          0.5    1       exp(-e²/0.5² rad²/s²), e the error of the rate about the vertical, rad/s
    upright           -1.0   1       squared sine of the angle between the base's z axis and the vertical
    vertical_velocity -1.0   m²/s²   squared vertical velocity of the base
    rocking           -0.05  rad²/s² squared angular velocity of the base about its x and y axes
    alive             0.5    1       1
    ================= ====== ======= ===============================================================================

    Terminated where the robot has fallen, as `humanoid_sim.evaluation.failure` defines it. A command holds
    for 5 s; one in ten is zero, the others are uniform over the contract's ranges.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType(
        {
            "linear_velocity": 1.0,
            "yaw_rate": 0.5,
            "upright": -1.0,
            "vertical_velocity": -1.0,
            "rocking": -0.05,
            "alive": 0.5,
            **Task.WEIGHTS,
        }
    )

    def _prepare(self, description: RobotDescription) -> None:
        contract = self.contract
        if not description.is_floating:
            raise InputError(f"{description.name}: has a fixed base, expected a floating one, to walk with")
        ranges = _RANGES if contract.command_ranges is None else contract.command_ranges
        self._low, self._width = ranges[:, 0], ranges[:, 1] - ranges[:, 0]
        self._command_steps = max(round(_COMMAND_SECONDS / contract.policy_dt), 1)
        self._command_count = -(-self.episode_steps // self._command_steps)
        self.draws += 4 * self._command_count

    def _commands(self, numbers: FloatArray) -> FloatArray:
        drawn = numbers.reshape(*numbers.shape[:-1], self._command_count, 4)
        return np.where(drawn[..., 3:] < _STANDING, 0.0, self._low + self._width * drawn[..., :3])

    def command(self, commands: FloatArray, step: int | npt.NDArray[np.integer]) -> FloatArray:
        """See `Task.command`."""
        i = np.minimum(np.asarray(step) // self._command_steps, commands.shape[-2] - 1)
        command: FloatArray = np.take_along_axis(commands, i[..., None, None], axis=-2)[..., 0, :]
        return command

    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        base = sample.base
        assert base is not None
        error = base.planar_velocity - sample.command
        velocity, turning = error[..., :2], error[..., 2]
        gravity, rocking = base.gravity[..., :2], base.angular_velocity[..., :2]
        vertical = base.linear_velocity[..., 2]
        values = {
            "linear_velocity": np.exp(total(velocity * velocity) / -(_LINEAR_SCALE**2)),
            "yaw_rate": np.exp(turning * turning / -(_YAW_SCALE**2)),
            "upright": total(gravity * gravity),
            "vertical_velocity": vertical * vertical,
            "rocking": total(rocking * rocking),
            "alive": np.ones_like(vertical),
        }
        return values, np.zeros(vertical.shape, dtype=np.bool_)


class WalkingTask(VelocityTask):
    """`VelocityTask` with a gait.

    The clock's phase tells which of two feet swings: the left one while its sine is positive, the right one while it
    is negative; while the command is to stand, neither does. The robot's `hands` are its feet, the left one first.

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

    def _prepare(self, description: RobotDescription) -> None:
        super()._prepare(description)
        if self.contract.phase is None:
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
        return np.where(drawn[..., 3:] < _STANDS, 0.0, command)

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
