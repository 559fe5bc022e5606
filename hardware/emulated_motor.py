"""Interface of emulated motors of any family to the emulator: a firmware, its state, its sensors and its drive."""

from __future__ import annotations

from typing import Generic, NamedTuple, Protocol, TypeVar

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.robots.motors import MotorModel

State = TypeVar("State")


class Sensed(NamedTuple):
    """Readings of a motor's own sensors at one instant, in rad, s, N·m, °C and V."""

    shaft: float
    """Angle of the shaft with all its turns, motor frame."""
    velocity: float = 0.0
    torque: float = 0.0
    """Computed from the phase currents."""
    temperature: float = 25.0
    voltage: float = 48.0
    encoder_fault: bool = False
    overcurrent: bool = False
    overloaded: bool = False


class Reaction(NamedTuple, Generic[State]):
    """Reaction of a motor to an event."""

    state: State
    frames: tuple[Frame, ...] = ()
    """Frames in the order in which the motor sends them."""
    refusal: str = ""
    """Reason why it did not obey, for a person: its answer, if it has one, does not say."""


class Drive(NamedTuple):
    """The MIT command in force, motor frame, and its limit, in rad, s and N·m.

    Without power all gains and the effort are zero.
    """

    position: float
    velocity: float
    effort: float
    stiffness: float
    damping: float
    limit: float
    """Bound of the torque."""
    origin: float
    """The shaft's angle that counts as position 0."""


class Firmware(Protocol[State]):
    """One motor's firmware, as pure functions of its state. Times are s on the emulator's clock."""

    model: MotorModel
    """With this firmware's position range."""

    def power_on(self, before: State | None, sensed: Sensed) -> State:
        """Return the state after booting; `before`, when it lost its power: what it has stored stays."""

    def reset(self, state: State) -> State:
        """Return the state after falling back to what it is after power-on without losing its power."""

    def is_for(self, state: State, frame: Frame) -> bool:
        """Return whether a frame names this motor."""

    def receive(self, state: State, frame: Frame, sensed: Sensed, time: float) -> Reaction[State]:
        """Return a frame that names it."""

    def advance(self, state: State, sensed: Sensed, time: float) -> Reaction[State]:
        """Return what it does of itself at a time."""

    def next_time(self, state: State) -> float:
        """Return when `advance` has something to do at the latest, protections apart; infinity: never."""

    def drive(self, state: State) -> Drive:
        """Return what its control loop does."""

    def changes(self, before: State, state: State) -> tuple[str, ...]:
        """Return what is different, in words for a person."""

    def announcement(self, state: State) -> tuple[Frame, ...]:
        """Return what it sends when it has booted."""
        return ()

    def zero_torque(self, state: State) -> tuple[Frame, ...]:
        """Return what a computer sends that wants no torque of it."""

    def question(self, state: State) -> tuple[Frame, ...]:
        """Say what another computer sends that only asks it something; nothing where the protocol has no questions."""
        return ()
