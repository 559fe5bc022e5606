"""Actions of a guardian once the loop is gone, as data: ready frames for each motor, and when to send them."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.frame import Frame


@dataclass(frozen=True, slots=True)
class GuardedMotor:
    """One motor without a dead-man of its own, and the frames that brake it. The family's module makes them."""

    name: str
    channel: BusAddress
    damping: tuple[Frame, ...]
    """In the order in which they are sent, together, every period: damping gains without stiffness, and a command
    without effort. They must be harmless in any position of the joint and whatever was commanded before, also where one
    of them is lost: gains that matter go before the command that needs them, and may be there twice."""
    reset: tuple[Frame, ...]
    """After the damping: what makes the motor let go."""


@dataclass(frozen=True, slots=True)
class GuardianPlan:
    """All motors of a robot that need a guardian, and the times. One that would protect nothing is a `FieldError`."""

    motors: tuple[GuardedMotor, ...]
    timeout: float = 0.1
    """s without a heartbeat after which the guardian takes over."""
    damping_time: float = 3.0
    """s of damping before the motors are reset, as at the end of a session: the arms sink meanwhile."""
    period: float = 0.02
    """s between two rounds of frames."""
    reset_rounds: int = 5
    """Rounds in which the reset is sent."""

    def __post_init__(self) -> None:
        for name, largest in (("timeout", 1.0), ("damping_time", 60.0), ("period", 0.1)):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0.0 < value <= largest):
                raise FieldError(f"GuardianPlan.{name}: is {value}, expected more than 0 and at most {largest:g} s")
        if self.reset_rounds < 1:
            raise FieldError(f"GuardianPlan.reset_rounds: is {self.reset_rounds}, expected 1 or more")
        for motor in self.motors:
            if not (motor.damping and motor.reset):
                missing = "reset" if motor.damping else "damping"
                raise FieldError(
                    f"GuardianPlan.motors: {motor.name} has no frames for {missing}, expected at least one"
                )

    @property
    def channels(self) -> tuple[BusAddress, ...]:
        """The channels of the motors, each once, in order of appearance."""
        return tuple(dict.fromkeys(motor.channel for motor in self.motors))

    def to_json(self) -> str:
        """Return the plan on one line, for the other process."""
        document = {
            "motors": [
                {
                    "name": motor.name,
                    "channel": [motor.channel.interface, motor.channel.channel],
                    "damping": [_to_list(frame) for frame in motor.damping],
                    "reset": [_to_list(frame) for frame in motor.reset],
                }
                for motor in self.motors
            ],
            "timeout": self.timeout,
            "damping_time": self.damping_time,
            "period": self.period,
            "reset_rounds": self.reset_rounds,
        }
        return json.dumps(document)

    @classmethod
    def from_json(cls, text: str) -> GuardianPlan:
        """Return the plan of `to_json`'s text."""
        document = json.loads(text)
        motors = tuple(
            GuardedMotor(
                motor["name"],
                BusAddress(*motor["channel"]),
                tuple(_to_frame(item) for item in motor["damping"]),
                tuple(_to_frame(item) for item in motor["reset"]),
            )
            for motor in document.pop("motors")
        )
        return cls(motors, **document)


def _to_list(frame: Frame) -> list[Any]:
    return [frame.arbitration_id, frame.data.hex(), frame.is_extended]


def _to_frame(item: list[Any]) -> Frame:
    arbitration_id, data, is_extended = item
    return Frame(arbitration_id, bytes.fromhex(data), is_extended)
