"""Mock motors in real time on python-can channels, as `--hardware virtual:lite` and `hardware emulate` run them."""

from __future__ import annotations

import contextlib
import errno
import threading
import time
from collections.abc import Callable, Sequence
from typing import Self

import can

from humanoid_sim.hardware.bus.address import BusAddress, open_bus, parse_address
from humanoid_sim.hardware.bus.frame import Echoes, frame_of, message_of
from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.motors import Log, MockMotors, MockSettings
from humanoid_sim.mit import MITState
from humanoid_sim.robots.schema import RobotDescription

_POLL_PERIOD = 0.0005  # s between two polls of the channels
_TRUTH_PERIOD = 0.002  # s between two snapshots of the truth: 500 Hz, the rate of a common IMU
_MOST_AT_ONCE = 256  # frames read from one channel before time goes on: a flood must not stop the motors
_MOST_ECHOES = 1024  # frames of motors that are remembered until they are received again
_OLDEST = 2.0  # s between a frame's stamp and its reading that are believed
_MOST_BEHIND = 0.05  # s that the motors may be behind the clock; the rest is left out
_JOIN = 5.0  # s that closing waits for the thread


class MockServer:
    """A robot's motors on python-can channels, run by a thread of this process until `close`.

    A channel of the interface `virtual` exists in this process only. `open_bus` opens the computer's end of a channel
    with the faults of that end. On a computer that is too slow for them the motors' world stands still for a while;
    `slipped` says for how long. Methods may be called from any thread.
    """

    def __init__(
        self,
        description: RobotDescription,
        addresses: Sequence[BusAddress | str],
        *,
        settings: MockSettings | None = None,
        log: Log | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Power the motors on.

        Args:
            addresses: one channel for all motors, or one for each of the robot's buses, in order.
            log: see `MockMotors`; called on the motors' thread.
            clock: s; a slower one than real time shows everything in slow motion. The robot must have the same.
        """
        self.addresses = tuple(parse_address(one) if isinstance(one, str) else one for one in addresses)
        self._motors = MockMotors(description, len(self.addresses), settings, log)
        with contextlib.ExitStack() as opened:
            self._buses = tuple(_open(address, opened) for address in self.addresses)
            self._opened = opened.pop_all()
        self._clock, self._begin = clock, clock()
        self._lock, self._closing = threading.Lock(), threading.Event()
        self._echoes = tuple(Echoes(address.interface, _MOST_ECHOES) for address in self.addresses)
        self._truth = self._motors.plant.truth(self._begin)
        self.slipped = 0.0  # s for which the motors' world stood still
        self.failure: Exception | None = None  # exception that ended the thread; None while it runs
        self._thread = threading.Thread(target=self._run, name="mock motors", daemon=True)
        self._thread.start()

    @property
    def truth(self) -> MITState:
        """The true state, at most a few ms old; its time is on the host's clock."""
        return self._truth

    @property
    def time(self) -> float:
        """Seconds since the motors were powered on: the clock of faults."""
        return self._clock() - self._begin

    @property
    def joints(self) -> Sequence[str]:
        """The driven joints, one per motor."""
        return self._motors.names

    def call(self, action: Callable[[MockMotors], None]) -> None:
        """Change something in the simulation between two of its events."""
        with self._lock:
            action(self._motors)

    def inject(self, fault: Fault) -> None:
        """Schedule a fault on the clock of `time`."""
        self.call(lambda motors: motors.inject(fault))

    def clear_faults(self) -> None:
        """End the faults in force. What motors have latched stays."""
        self.call(lambda motors: motors.clear_faults())

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Support a floating base or let it go, see `MotorPlant.set_support`."""
        self.call(lambda motors: motors.plant.set_support(held, lifts=lifts))

    @property
    def supported(self) -> bool:
        """True while the support holds a floating base."""
        return self._motors.plant.supported

    def open_bus(self, address: BusAddress) -> can.BusABC:
        """Open the computer's end of a channel; one of these motors' channels with the faults of that end."""
        bus = open_bus(address)
        if address not in self.addresses:
            return bus
        index = self.addresses.index(address)
        return _FaultyBus(bus, str(address), lambda: self._motors.host_fault(index))

    def close(self) -> None:
        """Stop the thread and close the motors' ends of the channels. Raises what ended the thread."""
        if self._closing.is_set():
            return
        self._closing.set()
        with self._opened:
            self._thread.join(_JOIN)
            if self.failure is not None:
                raise self.failure

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        next_poll, next_truth = time.monotonic(), self._clock()
        try:
            while not self._closing.is_set():
                with self._lock:
                    now = self._clock()
                    self._poll(now)
                    if now >= next_truth:
                        self._truth = self._motors.plant.truth(now)
                        next_truth = now + _TRUTH_PERIOD
                next_poll = max(next_poll + _POLL_PERIOD, time.monotonic())
                time.sleep(max(next_poll - time.monotonic(), 0.0))
        except Exception as error:
            self.failure = error

    def _poll(self, now: float) -> None:
        """Take the frames that have come, at the times of their stamps, let time pass, and send what is due."""
        until = now - self._begin
        behind = until - self._motors.time
        if behind > _MOST_BEHIND:
            self._begin += behind
            self.slipped += behind
            until = self._motors.time
        wall = time.time()  # python-can's stamps
        for index, bus in enumerate(self._buses):
            for _ in range(_MOST_AT_ONCE):
                message = bus.recv(0.0)
                if message is None:
                    break
                # `is_rx` says nothing: on SocketCAN frames of other processes of this machine come without it
                if message.is_error_frame or message.is_fd:
                    continue
                frame, age = frame_of(message), wall - message.timestamp
                if not self._echoes[index].take(frame):
                    self._motors.submit(index, frame, until - age if 0.0 <= age < _OLDEST else until)
        for arrival in self._motors.advance(until):
            self._echoes[arrival.bus].expect(arrival.frame)
            with contextlib.suppress(can.CanError):  # a channel without a listener takes none
                self._buses[arrival.bus].send(message_of(arrival.frame, wall - until + arrival.time))


def _open(address: BusAddress, opened: contextlib.ExitStack) -> can.BusABC:
    if address.interface == "virtual":
        bus: can.BusABC = can.Bus(interface="virtual", channel=address.channel, preserve_timestamps=True)
    else:
        bus = open_bus(address)
    opened.callback(bus.shutdown)
    return bus


class _FaultyBus(can.BusABC):
    """A bus whose sending fails as SocketCAN's does: ENOBUFS where the queue is full, ENETDOWN after bus-off."""

    def __init__(self, bus: can.BusABC, channel: str, fault: Callable[[], str]) -> None:
        self._bus, self._fault = bus, fault
        super().__init__(channel)
        self._can_protocol = bus.protocol
        self.channel_info = bus.channel_info

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send, or raise `can.CanOperationError` with the error number of the fault."""
        match self._fault():
            case "tx_full":
                raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
            case "bus_off":
                raise can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
        self._bus.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self._bus._recv_internal(timeout)

    def shutdown(self) -> None:
        """Shut both down."""
        super().shutdown()
        self._bus.shutdown()
