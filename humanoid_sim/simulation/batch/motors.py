"""The motors of a batch: commands become MuJoCo's controls, at once or late, and the gains become the actuators'."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray, IndexArray, IntArray, MITCommand, affine_law, affine_torque
from humanoid_sim.simulation.batch.draws import Draws
from humanoid_sim.simulation.batch.physics import ModelPool

_LONG_AGO = np.iinfo(np.int64).min


@dataclass(frozen=True, slots=True, eq=False)
class MotorDifferences:
    """Differences between the motors of N robots."""

    delay: IntArray
    """Shape (N,), physics steps from a command to its arrival, without jitter."""
    stiffness: FloatArray
    """Shape (N, n), the motor's K_p over the commanded one."""
    damping: FloatArray
    """Shape (N, n), the motor's K_d over the commanded one."""
    strength: FloatArray
    """Shape (N, n), the motor's torque over the one that it means to apply."""
    limit: FloatArray
    """Shape (N, n), N·m, of the torque that the motor does apply."""
    bias: FloatArray
    """Shape (N, n), rad, by how much the motor's encoder shows too much."""
    own_strength: FloatArray
    """Shape (n,), as `strength`: that of the robot's description."""
    own_delay: int
    """As `delay`: that of the robot's description."""

    @classmethod
    def none(cls, count: int, limit: FloatArray, strength: FloatArray | float = 1.0, delay: int = 0) -> Self:
        """Return those of motors as the description has them.

        Args:
            count: N.
            limit: shape (n,), N·m, of the torque that they do apply.
            strength: shape (n,), or one for all.
            delay: physics steps.
        """
        own = np.full(len(limit), strength)
        shape, delays = (count, len(limit)), np.full(count, delay, dtype=np.int64)
        limits, strengths = (np.broadcast_to(array, shape).copy() for array in (limit, own))
        return cls(delays, np.ones(shape), np.ones(shape), strengths, limits, np.zeros(shape), own, delay)

    def draw(self, indices: IndexArray, draws: Draws, timestep: float, effort_limit: FloatArray) -> None:
        """Take over what is drawn for these environments' episodes; `timestep` is of the physics, s."""
        self.delay[indices] = self.own_delay + np.rint(draws.ranged("command_delay", indices)[:, 0] / timestep)
        self.stiffness[indices] = draws.ranged("stiffness", indices)
        self.damping[indices] = draws.ranged("damping", indices)
        strength = draws.ranged("motor_strength", indices)
        self.strength[indices] = self.own_strength * strength
        factor = strength * draws.ranged("effort_limit", indices)
        self.limit[indices] = np.where(np.isfinite(effort_limit), effort_limit, 1.0) * factor
        self.limit[:, ~np.isfinite(effort_limit)] = np.inf
        self.bias[indices] = draws.symmetric("joint_position_bias", indices)

    def applied(self, command: MITCommand) -> MITCommand:
        """Return the command that motors without differences would have to be given, shape (N, n), for the same torque.

        Twice as strong a motor is one with twice the gains and limits; one whose encoder shows too much aims too low.
        """
        return MITCommand(
            position=command.position - self.bias,
            velocity=command.velocity,
            effort=command.effort * self.strength,
            stiffness=command.stiffness * (self.stiffness * self.strength),
            damping=command.damping * (self.damping * self.strength),
        )


class BatchMotors:
    """The MIT law of N robots, in its affine form.

    What is commanded arrives late by a delay of its own for each environment. The gains are part of the model and do
    not: new ones hold from the command's own step on, for the targets under way too. Policies never change theirs.
    """

    def __init__(
        self,
        pool: ModelPool,
        steps: int,
        differences: MotorDifferences,
        draws: Draws,
        *,
        longest_delay: int,
        jitter: int,
    ) -> None:
        """Set up the line of commands under way.

        Args:
            steps: physics steps per command.
            differences: of the N robots; their arrays may change at any time.
            longest_delay: physics steps, beyond which no delay will ever be drawn.
            jitter: physics steps, the greatest further delay.
        """
        self._pool = pool
        self._steps = steps
        self._jitter = jitter
        self._draws = draws
        self.differences = differences
        count, n = differences.stiffness.shape
        self._bias = np.zeros((count, n, 2))
        # The last commands, the newest last: as many as can be under way, and the one in force before them.
        self._slots = 1 + -(-(differences.own_delay + longest_delay + jitter) // steps)
        self._targets = np.zeros((self._slots, count, 3, n))
        self._controls = np.zeros((self._slots, count, n))
        self._arrival = np.full((self._slots, count), _LONG_AGO)
        self._control = np.zeros((count, steps, n))
        self._clock = np.arange(steps, dtype=np.int64)

    def hold(self, indices: IndexArray, position: FloatArray) -> None:
        """Forget the commands of some environments; until another arrives they hold a position, shape (k, n), rad."""
        self._targets[:, indices] = 0.0
        self._targets[:, indices, 0] = position
        self._controls[:, indices] = -self._bias[indices, :, 0] * position
        self._arrival[:, indices] = _LONG_AGO

    def send(self, command: MITCommand, step: IntArray, chosen: IndexArray | None) -> FloatArray:
        """Take a command, shape (N, n), finite, and give the controls of the physics steps until the next.

        Args:
            step: shape (N,), commands since each environment's start.
            chosen: shape (k,), the environments for which time goes on; None for all.

        Returns:
            Shape (N, steps, n), N·m; the same buffer every time.
        """
        own = self.differences
        command = own.applied(command)
        bias, control = affine_law(command)
        self._set_gains(bias, command)
        if self._slots == 1:
            self._control[:] = control[:, None]
            return self._control
        begin = step * self._steps
        arrival = begin + own.delay
        if self._jitter:
            drawn = self._draws.shares("jitter", step, 1)[:, 0]
            arrival += np.floor(drawn * (np.rint(self._jitter) + 1)).astype(np.int64)
        moving: slice | IndexArray = slice(None) if chosen is None else chosen
        for line, newest in (
            (self._targets, np.stack([command.position, command.velocity, command.effort], axis=1)),
            (self._controls, control),
            (self._arrival, arrival),
        ):
            line[:-1, moving] = line[1:, moving]
            line[-1, moving] = newest[moving]
        self._control[:] = self._controls[0][:, None]
        now = begin[:, None] + self._clock
        for since, late in zip(self._arrival[1:], self._controls[1:], strict=True):
            np.copyto(self._control, late[:, None], where=(since[:, None] <= now)[:, :, None])
        return self._control

    def torque(self, position: FloatArray, velocity: FloatArray, control: FloatArray | None = None) -> FloatArray:
        """Shape (N, n), N·m, saturated, of a physics step that began at this joint state, (N, n), rad and rad/s.

        `control`, (N, n), is the one in force in it; None: in the last of the physics steps.
        """
        control = self._control[:, -1] if control is None else control
        return affine_torque(self._bias, control, position, velocity, self.differences.limit)

    def snapshot(self) -> tuple[npt.NDArray[Any], ...]:
        """Return copies of the gains and of the commands in force and under way, for `restore`."""
        arrays = self._bias, self._targets, self._controls, self._arrival, self._control
        return tuple(array.copy() for array in arrays)

    def restore(self, snapshot: Sequence[npt.NDArray[Any]]) -> None:
        """Take over a snapshot of as many motors."""
        self._bias, *others = (array.copy() for array in snapshot)
        self._targets, self._controls, self._arrival, self._control = others
        self._pool.set_gains(np.arange(len(self._bias)), self._bias)

    def _set_gains(self, bias: FloatArray, command: MITCommand) -> None:
        """Put a command's gains, which are `bias`, into the models and apply them to the targets under way."""
        changed = (bias != self._bias).any(axis=(1, 2))
        if not changed.any():
            return
        self._bias = bias
        self._pool.set_gains(np.flatnonzero(changed), bias)
        for targets, control in zip(self._targets, self._controls, strict=True):
            position, velocity, effort = (targets[:, i] for i in range(3))
            _, control[:] = affine_law(replace(command, position=position, velocity=velocity, effort=effort))
