"""Shared by a loop and its guardian: what to do once the loop is gone, as data, and counters as signs of life.

The counters are in shared memory, each written by one of the two, without a lock. The loop counts its commands and the
frames that left on each channel; the guardian counts its own looks. Whoever reads notices when a counter stands still,
by a clock of its own: a reader that was held up itself is not misled. Nothing here is a system call once the memory is
there.
"""

from __future__ import annotations

import math
import mmap
import os
import tempfile
from dataclasses import dataclass
from enum import IntEnum

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


_PHASE, _BEATS, _STAGE, _LOOKS, _SENT = range(5)
"""Places of 8 bytes: whole and aligned, so that a reader sees the old number or the new one."""


class Phase(IntEnum):
    """Phase of the loop. Written by the loop."""

    IDLE = 0
    """No motor is enabled: nothing has to be protected."""
    STANDBY = 1
    """Motors may be enabled, without torque or at rest: only the end of the loop's process counts."""
    ARMED = 2
    """Motors are commanded: a heartbeat that stands still counts."""
    RELEASED = 3
    """Motors are disabled, and the guardian is to end."""
    ABANDONED = 4
    """Motors did not confirm that they are disabled: the guardian is to brake them, and to end."""
    DISPLACED = 5
    """The guardian has taken over, and the loop has seen it: nothing of the loop's can leave any more."""


class Stage(IntEnum):
    """Stage of the guardian. Written by the guardian."""

    STARTING = 0
    WATCHING = 1
    DAMPING = 2
    """It has taken over: from here on the loop must not send."""
    RESET = 3


class Heartbeat:
    """One end of the memory."""

    def __init__(self, descriptor: int, channel_count: int) -> None:
        """Map the memory of a descriptor, which becomes this object's, with a counter for each channel."""
        self.descriptor = descriptor
        size = 8 * (_SENT + channel_count)
        if os.fstat(descriptor).st_size < size:
            os.ftruncate(descriptor, size)
        self._map = mmap.mmap(descriptor, size)
        self._places = memoryview(self._map).cast("Q")

    @classmethod
    def create(cls, channel_count: int) -> Heartbeat:
        """Return new memory without a name: it is gone when both processes are."""
        if hasattr(os, "memfd_create"):
            return cls(os.memfd_create("humanoid_sim-heartbeat"), channel_count)
        with tempfile.TemporaryFile() as file:
            return cls(os.dup(file.fileno()), channel_count)

    def close(self) -> None:
        """Let go of it. May be called twice."""
        if self.descriptor >= 0:
            self._places.release()
            self._map.close()
            os.close(self.descriptor)
            self.descriptor = -1

    # --- the loop's end

    @property
    def phase(self) -> Phase:
        """Return what the loop is doing."""
        return Phase(self._places[_PHASE])

    @phase.setter
    def phase(self, phase: Phase) -> None:
        self._places[_PHASE] = phase

    def beat(self) -> None:
        """Note that a command was handed to every motor."""
        self._places[_BEATS] += 1

    def count_sent(self, channel: int) -> None:
        """Count a frame that has left on a channel; called on that channel's sending thread."""
        self._places[_SENT + channel] += 1

    @property
    def signs_of_life(self) -> tuple[int, ...]:
        """The counters that must not stand still: commands, and frames that left, by channel."""
        return (self._places[_BEATS], *self._places[_SENT:])

    # --- the guardian's end

    @property
    def stage(self) -> Stage:
        """Return what the guardian is doing."""
        return Stage(self._places[_STAGE])

    @stage.setter
    def stage(self, stage: Stage) -> None:
        self._places[_STAGE] = stage

    def look(self) -> None:
        """Note that the guardian has looked."""
        self._places[_LOOKS] += 1

    @property
    def looks(self) -> int:
        """Times that the guardian has looked."""
        return self._places[_LOOKS]
