"""What of a command the motors can be told, and how often it was less than was asked."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robot.tracker import JointReadings, JointTracker
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.codec import OperationControlEncoder
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand, bounded_position

__all__ = ["CommandEncoder"]


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
