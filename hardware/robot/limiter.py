"""What of a command the motors can be told, and how often it was less than was asked."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.robot.tracker import JointReadings, JointTracker
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.codec import OperationControlEncoder
from humanoid_sim.hardware.robstride.frames import Frame
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand

__all__ = ["CommandEncoder", "bounded_position"]


def bounded_position(
    command: MITCommand, position: FloatArray, velocity: FloatArray, effort_limit: FloatArray, lead: float
) -> FloatArray:
    """Commanded positions, moved towards the joints where the MIT law would ask for more than the effort limit.

    No manual says that the firmware's torque limit covers the sum of the MIT law, so the host bounds it as well. What
    the host knows is as old as the last status and holds for a whole period: the bound leaves K_p |velocity| lead of
    room, so that a joint on its way is not slowed down, as the same law with a limit in the motor would not.

    Args:
        command: shape (n,), joint frame, its effort within the limit.
        position: shape (n,), rad, where the joints are; NaN: no bound.
        velocity: shape (n,), rad/s.
        effort_limit: shape (n,), N·m.
        lead: s, the age of a state and the time that a command is held.

    Returns:
        Shape (n,), rad. Where damping and feed-forward are beyond the limit by themselves, at most the spring's part is
        taken out; it never changes sign.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # no stiffness, no position, absurd commands
        spring = command.stiffness * (command.position - position)
        rest = command.damping * (command.velocity - velocity) + command.effort
        room = command.stiffness * np.abs(velocity) * lead
        lowest = np.minimum(-effort_limit - rest - room, 0.0)
        highest = np.maximum(effort_limit - rest + room, 0.0)
        bounded = np.clip(spring, lowest, highest)
        moved = position + bounded / command.stiffness
    return np.where((bounded != spring) & np.isfinite(moved), moved, command.position)


class CommandEncoder:
    """Joint commands to frames, counting what was cut off."""

    def __init__(self, wiring: Wiring, channel_count: int, lead: float) -> None:
        """Prepare.

        Args:
            wiring: joints and motors.
            channel_count: channels to encode for.
            lead: s, see `bounded_position`.
        """
        self._wiring = wiring
        self._lead = lead
        self._joints = tuple(np.array(wiring.on_channel(channel), dtype=int) for channel in range(channel_count))
        self._encoders = tuple(
            OperationControlEncoder([wiring.motor_id[i] for i in joints], [wiring.model[i] for i in joints])
            for joints in self._joints
        )
        self._saturated: npt.NDArray[np.int64] = np.zeros((len(COMMAND_FIELDS), wiring.count), dtype=np.int64)
        self._bounded: npt.NDArray[np.int64] = np.zeros(wiring.count, dtype=np.int64)

    def encode(
        self, command: MITCommand, state: JointReadings, tracker: JointTracker
    ) -> tuple[tuple[tuple[int, Frame], ...], ...]:
        """For each channel the joints and their frames. The command must be finite, its shape (n,)."""
        wiring = self._wiring
        limit = wiring.effort_limit
        effort = np.clip(command.effort, -limit, limit)
        limited = MITCommand(command.position, command.velocity, effort, command.stiffness, command.damping)
        position = bounded_position(limited, state.position, state.velocity, limit, self._lead)
        self._saturated[2] += effort != command.effort
        self._bounded += position != command.position
        values = np.array(
            [
                tracker.to_motor(position),
                wiring.direction * command.velocity,
                wiring.direction * effort,
                command.stiffness,
                command.damping,
            ]
        )
        batches = []
        for joints, encoder in zip(self._joints, self._encoders, strict=True):
            encoded = encoder.encode(values[:, joints])
            self._saturated[:, joints] += encoded.saturated
            batches.append(tuple(zip(joints.tolist(), encoded.frames, strict=True)))
        return tuple(batches)

    @property
    def saturations(self) -> Mapping[str, Mapping[str, int]]:
        """By joint and field of the command: how often a value was cut off. Joints without any are left out."""
        return {
            name: {field: int(n) for field, n in zip(COMMAND_FIELDS, self._saturated[:, i], strict=True) if n}
            for i, name in enumerate(self._wiring.names)
            if self._saturated[:, i].any()
        }

    @property
    def bounded(self) -> Mapping[str, int]:
        """By joint: how often the position was moved so that the MIT law stays within the effort limit."""
        return {name: int(n) for name, n in zip(self._wiring.names, self._bounded, strict=True) if n}
