"""Emulated motors with a robot that is driven on them; faults, commands and what became of the motors."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import can
from drive_rig import Clock, Drive, driven, quick_lite

from humanoid_sim.hardware.bus.address import BusAddress, PassingBus
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.session.realtime import punctual_threads, real_time


@dataclass(frozen=True)
class Sent:
    """One operation control frame that was handed to the driver."""

    time: float
    """s, the robot's slow clock."""
    motor_id: int
    has_stiffness: bool
    has_damping: bool
    is_refused: bool
    """The driver did not take it."""
    awaits_gains: bool = False
    """A Sito's command: its gains are in frames of their own, of which a softer one may stand behind it in a queue that
    was jammed. Its position is then that of the joint."""


class WatchedBus(PassingBus):
    """Writes down the commands that are handed to the driver."""

    def __init__(self, bus: can.BusABC, log: list[Sent], clock: Clock) -> None:
        self._log, self._clock = log, clock
        self._gains: dict[int, tuple[bytes, bytes]] = {}
        super().__init__(bus, bus.channel_info)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        is_refused = True
        begin = self._clock()
        try:
            super().send(msg, timeout)
            is_refused = False
        finally:
            if (command := self._command(msg)) is not None:
                motor_id, stiffness, damping = command
                awaits = msg.arbitration_id >> 16 == 0x0506 and msg.arbitration_id & 0xFF == 0x09
                self._log.append(Sent(begin, motor_id, any(stiffness), any(damping), is_refused, awaits))

    def _command(self, msg: can.Message) -> tuple[int, bytes, bytes] | None:
        """Motor, K_p and K_d of a frame that commands one; a Sito's gains hold until it is told others."""
        if msg.arbitration_id >> 24 == 1:
            return msg.arbitration_id & 0xFF, bytes(msg.data[4:6]), bytes(msg.data[6:8])
        prefix, motor_id, kind = msg.arbitration_id >> 16, msg.arbitration_id >> 8 & 0xFF, msg.arbitration_id & 0xFF
        if prefix != 0x0506 or kind not in {0x09, 0x45}:
            return None
        if kind == 0x45:
            self._gains[motor_id] = bytes(msg.data[:4]), bytes(msg.data[4:])
        return motor_id, *self._gains.get(motor_id, (b"", b""))


class Diary:
    """What happened to the motors, as they tell it: s, slow clock, and a line."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.lines: list[tuple[float, str]] = []

    def __call__(self, _: float, text: str) -> None:
        self.lines.append((self._clock(), text))

    def times_of(self, ending: str, since: float) -> list[float]:
        """When lines with this end were written, from `since` on."""
        return [when for when, text in self.lines if when >= since and text.endswith(ending)]


@contextmanager
def emulated(address: str, clock: Clock = time.monotonic, robot: str = "lite") -> Iterator[tuple[MockServer, Diary]]:
    """Motors of the Lite, on a thread that other programs on this computer do not hold up, where that is permitted."""
    diary = Diary(clock)
    with punctual_threads(behind=10):
        motors = MockServer(quick_lite(robot), [address], log=diary, clock=clock)
    with motors:
        yield motors, diary


@dataclass(frozen=True)
class Campaign:
    """One run; `sent` and the diary grow as it goes."""

    drive: Drive
    motors: MockServer
    sent: list[Sent]
    diary: Diary


@contextmanager
def campaign(slowness: float = 1.0, robot: str = "lite") -> Iterator[Campaign]:
    """Motors and a robot in ZERO_TORQUE, as punctual as `play`; all of it in slow motion by that factor."""
    address = "virtual:campaign"
    sent: list[Sent] = []

    def clock() -> float:
        return time.monotonic() / slowness

    with emulated(address, clock, robot) as (motors, diary):

        def open_watched(channel: BusAddress) -> can.BusABC:
            return WatchedBus(motors.open_bus(channel), sent, clock)

        with (
            real_time(),
            driven(
                address,
                clock=clock,
                open_bus=open_watched,
                truth=lambda: motors.truth,
                before_closing=motors.clear_faults,  # so that the motors confirm that they are disabled
                description=quick_lite(robot),
            ) as drive,
        ):
            yield Campaign(drive, motors, sent, diary)
