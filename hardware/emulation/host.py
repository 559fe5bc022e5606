"""Emulated motors in real time on python-can channels: a thread that takes frames, lets time pass, and sends frames.

And the computer's end of such a channel, with faults of its own: what a driver answers when frames cannot leave.
"""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable, Sequence
from typing import Self

import can

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import BusAddress, Echoes, frame_of, message_of
from humanoid_sim.hardware.bus.passing import PassingBus
from humanoid_sim.hardware.emulation.emulator import Emulator
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.plant import PlantTruth

_POLL_PERIOD = 0.0005
"""s between two looks at the channels. Frames are emulated at the times of their stamps, not of these looks."""
_TRUTH_PERIOD = 0.002
"""s between two snapshots of the truth: 500 Hz, the rate of a common IMU."""
_MOST_AT_ONCE = 256
"""Frames taken from one channel before time goes on: a flood must not stop the motors."""
_MOST_ECHOES = 1024
"""Frames of motors that are remembered until they are heard again."""
_OLDEST = 2.0
"""s between a frame's stamp and its reading that are believed."""
_MOST_BEHIND = 0.05
"""s that the motors may be behind the clock before the time that is missing is left out."""
_JOIN = 5.0
"""s that closing waits for the thread."""


class EmulatorHost:
    """Runs an emulator until it is closed. `inject` and the like may be called from any thread.

    A frame is emulated at the time of its stamp, so that a thread that is late changes nothing but when the answers can
    be read; their stamps again say when they came over the bus, where the interface keeps them.

    On a computer that cannot run them in real time the motors' world stands still for a while now and then, rather than
    answer later and later: no bus queues for seconds. What waits for a bus passes at once then, or those with the least
    priority would seem silent. `slipped` says for how long.
    """

    def __init__(
        self,
        emulator: Emulator,
        buses: Sequence[can.BusABC],
        *,
        addresses: Sequence[BusAddress],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start.

        Args:
            buses: open; they stay so, closing them is the caller's.
            clock: s; one that goes slower than real time shows everything in slow motion.
        """
        self._emulator = emulator
        self._buses = tuple(buses)
        self._clock = clock
        self._begin = clock()
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._echoes = tuple(Echoes(address, _MOST_ECHOES) for address in addresses)
        self._truth = emulator.motors.plant.truth(self._begin)
        self.slipped = 0.0
        """s for which the motors' world stood still because this computer was too slow."""
        self.send_errors = 0
        """Frames that a channel did not take."""
        self.failure: Exception | None = None
        """Exception that ended the thread; None while it runs."""
        self._thread = threading.Thread(target=self._run, name="emulated motors", daemon=True)
        self._thread.start()

    @property
    def truth(self) -> PlantTruth:
        """The latest snapshot, at most a few ms old; its time is on the host's clock."""
        return self._truth

    @property
    def time(self) -> float:
        """Seconds since the motors were powered on: the clock of faults."""
        return self._clock() - self._begin

    def inject(self, fault: Fault) -> None:
        """Schedule a fault on the clock of `time`; one whose start is past begins at once.

        Raises:
            InputError: it names a joint without a motor.
        """
        with self._lock:
            self._emulator.inject(fault)

    def call(self, action: Callable[[Emulator], None]) -> None:
        """Do something with the emulator between two of its events."""
        with self._lock:
            action(self._emulator)

    def close(self) -> None:
        """Stop the thread: the motors are gone. May be called twice.

        Raises:
            Exception: that of the thread, if it had ended by one.
        """
        if self._closing.is_set():
            return
        self._closing.set()
        self._thread.join(_JOIN)
        if self.failure is not None:
            raise self.failure

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        next_look = time.monotonic()
        next_truth = self._clock()
        try:
            while not self._closing.is_set():
                with self._lock:
                    now = self._clock()
                    self._look(now)
                    if now >= next_truth:
                        self._truth = self._emulator.motors.plant.truth(now)
                        next_truth = now + _TRUTH_PERIOD
                next_look = max(next_look + _POLL_PERIOD, time.monotonic())
                time.sleep(max(next_look - time.monotonic(), 0.0))
        except Exception as error:
            self.failure = error

    def _look(self, now: float) -> None:
        """Take what has come, let time pass, send what is due."""
        until = now - self._begin
        behind = until - self._emulator.time
        if behind > _MOST_BEHIND:
            self._begin += behind
            self.slipped += behind
            self._emulator.hurry()
            until = self._emulator.time
        # What python-can stamps is the system's wall clock, or whatever a driver counts: see `_arrival`.
        wall = time.time()
        for index, bus in enumerate(self._buses):
            for _ in range(_MOST_AT_ONCE):
                message = _received(bus)
                if message is None:
                    break
                # `is_rx` is not asked: on SocketCAN what other processes of this machine send comes without it.
                if message.is_error_frame or message.is_fd:
                    continue
                frame = frame_of(message)
                if not self._echoes[index].take(frame):
                    self._emulator.submit(index, frame, self._arrival(message.timestamp, wall, until))
        for arrival in self._emulator.advance(until):
            self._echoes[arrival.bus].expect(arrival.frame)
            try:
                self._buses[arrival.bus].send(message_of(arrival.frame, wall - until + arrival.time))
            except can.CanError:
                self.send_errors += 1

    def _arrival(self, stamp: float, wall: float, now: float) -> float:
        """Return the emulator's time of a stamp: between the last look, which the emulator sees to itself, and now."""
        return min(now - (wall - stamp), now) if wall - stamp < _OLDEST else now


def _received(bus: can.BusABC) -> can.Message | None:
    try:
        return bus.recv(0.0)
    except can.CanError as error:
        raise RobotError(f"{bus.channel_info}: receiving fails: {error}") from None


class FaultyBus(PassingBus):
    """Passes everything on to another bus, unless a fault says otherwise.

    The errors are those that SocketCAN raises: ENOBUFS where the queue is full, ENETDOWN after bus-off.
    """

    def __init__(self, bus: can.BusABC, channel: str, fault: Callable[[], str]) -> None:
        """Take over a bus.

        Args:
            fault: what is wrong now: `bus_off`, `enobufs`, or nothing (empty).
        """
        self._fault = fault
        super().__init__(bus, channel)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send, or raise.

        Raises:
            can.CanOperationError: with the error number of the fault.
        """
        fault = self._fault()
        if fault == "enobufs":
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        if fault == "bus_off":
            raise can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
        super().send(msg, timeout)
