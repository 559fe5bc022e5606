"""A Sito motor's firmware as a pure state machine. There is no manual: most of it is assumed.

Assumed, and compared with no motor: a disabled motor takes gains and commands (`is_deaf`: it does not, and starts with
those of its last host); gains and command outlive a reset, and not the power; feedback runs while the motor is enabled,
and its two frames go out together; the encoder of the output is absolute within one turn; a motor that protects itself
goes limp and silent, because no frame that could tell is known; nothing limits the torque but the range of the current;
nothing stops a motor whose host has fallen silent; position mode, which nothing here selects, leaves it limp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Drive, Firmware, Reaction, Sensed
from humanoid_sim.hardware.sito.codec import (
    Command,
    Feedback,
    Gains,
    Mode,
    PositionFeedback,
    Reset,
    SelectMode,
    decode,
    encode,
    split_identifier,
)
from humanoid_sim.robots.motors import MotorModel

_LEAST_VOLTAGE, _MOST_VOLTAGE = 12.0, 60.0
"""V, beyond which it protects itself: assumed as for the other motors of the robot."""
_HOTTEST = 120.0
"""°C, assumed."""


@dataclass(frozen=True, slots=True)
class SitoState:
    """A motor between two events. Times are s on the emulator's clock."""

    can_id: int
    origin: float
    """rad, the shaft's angle that counts as position 0, turns included."""
    is_running: bool = False
    """True while it is enabled, in MIT mode."""
    gains: Gains | None = None
    """Gains in force; None: zero, as after power-on."""
    command: Command | None = None
    intervals: tuple[float, float] = (0.0, 0.0)
    """s between two frames of feedback 1 and 2; 0: none."""
    next_feedback: tuple[float, float] = (math.inf, math.inf)
    """Times at which the next ones are due."""


class SitoFirmware(Firmware[SitoState]):
    """See `Firmware`."""

    def __init__(self, model: MotorModel, device_id: int, is_deaf: bool = False) -> None:
        """Make a motor with its id."""
        self.model = model
        self._device_id = device_id
        self._is_deaf = is_deaf

    def power_on(self, before: SitoState | None, sensed: Sensed) -> SitoState:
        """See `Firmware`: the first position lies in -π to π."""
        position = math.remainder(sensed.shaft, 2.0 * math.pi)
        return SitoState(self._device_id if before is None else before.can_id, sensed.shaft - position)

    def reset(self, state: SitoState) -> SitoState:
        """See `Firmware`."""
        return replace(state, is_running=False, next_feedback=(math.inf, math.inf))

    def is_for(self, state: SitoState, frame: Frame) -> bool:
        """See `Firmware`."""
        parts = split_identifier(frame)
        return parts is not None and parts[0] == state.can_id

    def receive(  # noqa: PLR0911 - one for each message
        self, state: SitoState, frame: Frame, sensed: Sensed, time: float
    ) -> Reaction[SitoState]:
        """See `Firmware`: nothing is answered, and what cannot be read changes nothing."""
        match decode(frame, self.model):
            case Reset():
                return Reaction(self.reset(state))
            case SelectMode(mode=Mode.MIT, intervals=(first, second, _)):
                if _has_tripped(sensed):
                    return Reaction(state, refusal="not enabled: it protects itself")
                intervals = first / 1000.0, second / 1000.0
                due = time + intervals[0] if first else math.inf, time + intervals[1] if second else math.inf
                return Reaction(replace(state, is_running=True, intervals=intervals, next_feedback=due))
            case SelectMode():
                return Reaction(self.reset(state), refusal="not enabled: only MIT mode is emulated")
            case Gains() as gains if state.is_running or not self._is_deaf:
                return Reaction(replace(state, gains=gains))
            case Command() as command if state.is_running or not self._is_deaf:
                return Reaction(replace(state, command=command))
            case _:
                return Reaction(state)

    def advance(self, state: SitoState, sensed: Sensed, time: float) -> Reaction[SitoState]:
        """See `Firmware`: protection, and feedback by its own clock."""
        if state.is_running and _has_tripped(sensed):
            return Reaction(self.reset(state))
        frames: list[Frame] = []
        first, second = state.next_feedback
        if time >= first:
            velocity = _cut(sensed.velocity, self.model.velocity)
            feedback = Feedback(state.can_id, velocity, _cut(sensed.torque, self.model.effort))
            frames.append(encode(feedback, self.model))
            first += state.intervals[0] * math.ceil((time - first) / state.intervals[0] + 1e-9)
        if time >= second:
            position = _cut(sensed.shaft - state.origin, self.model.position)
            frames.append(encode(PositionFeedback(state.can_id, position), self.model))
            second += state.intervals[1] * math.ceil((time - second) / state.intervals[1] + 1e-9)
        if not frames:
            return Reaction(state)
        return Reaction(replace(state, next_feedback=(first, second)), tuple(frames))

    def next_time(self, state: SitoState) -> float:
        """See `Firmware`."""
        return min(state.next_feedback)

    def drive(self, state: SitoState) -> Drive:
        """See `Firmware`: gains without a command hold position 0, which is what the MIT law says of zeros."""
        limit = self.model.peak_torque
        if not state.is_running:
            return Drive(0.0, 0.0, 0.0, 0.0, 0.0, limit, state.origin)
        stiffness, damping = (0.0, 0.0) if state.gains is None else (state.gains.stiffness, state.gains.damping)
        if state.command is None:
            return Drive(0.0, 0.0, 0.0, stiffness, damping, limit, state.origin)
        command = state.command
        return Drive(command.position, command.velocity, command.effort, stiffness, damping, limit, state.origin)

    def changes(self, before: SitoState, state: SitoState) -> tuple[str, ...]:
        """See `Firmware`."""
        if state.is_running is before.is_running:
            return ()
        return ("enabled" if state.is_running else "disabled",)

    def zero_torque(self, state: SitoState) -> tuple[Frame, ...]:
        """See `Firmware`."""
        messages = Gains(state.can_id, 0.0, 0.0), Command(state.can_id, 0.0, 0.0, 0.0)
        return tuple(encode(message, self.model) for message in messages)


def _has_tripped(sensed: Sensed) -> bool:
    return (
        sensed.temperature >= _HOTTEST
        or not _LEAST_VOLTAGE <= sensed.voltage <= _MOST_VOLTAGE
        or sensed.encoder_fault
        or sensed.overcurrent
        or sensed.overloaded
    )


def _cut(value: float, limit: float) -> float:
    """Return what an integer makes of a value beyond it: int16 velocity stands still at 3.14 rad/s."""
    return min(max(value, -limit), limit)
