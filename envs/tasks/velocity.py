"""Walk at a commanded velocity without falling."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.envs.tasks.task import BoolArray, Task
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.errors import total
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription

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

    def __init__(
        self, description: RobotDescription, contract: PolicyContract, reference: MotionReference, **options: Any
    ) -> None:
        """As `Task`, for a robot with a floating base.

        Raises:
            InputError: the base is fixed.
        """
        if not description.is_floating:
            raise InputError(f"{description.name}: has a fixed base, expected a floating one, to walk with")
        super().__init__(description, contract, reference, **options)
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
