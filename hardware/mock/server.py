"""Mock motors in real time on python-can channels, as `--hardware virtual:lite` and `hardware emulate` run them."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import can

from humanoid_sim.hardware.can_bus import BusAddress, frame_of, message_of, open_bus, parse_address
from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.motors import Log, MockMotors
from humanoid_sim.hardware.mock.robstride_motor import RobstrideMotor
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion
from humanoid_sim.mit import MITState
from humanoid_sim.robots.schema import RobotDescription

_POLL_PERIOD = 0.0005  # s between two polls of the channels
_TRUTH_PERIOD = 0.002  # s between two snapshots of the truth: 500 Hz, the rate of a common IMU
_MOST_AT_ONCE = 256  # frames read from one channel before time goes on: a flood must not stop the motors
_MOST_BEHIND = 0.05  # s that the motors may be behind; their clock stands still for the rest


class MockServer(contextlib.AbstractContextManager["MockServer"]):
    """A robot's motors on python-can channels, run by a thread of this process until `close`.

    A channel of the interface `virtual` exists in this process only. Methods may be called from any thread.
    """

    def __init__(
        self,
        description: RobotDescription,
        addresses: Sequence[BusAddress | str],  # one for all motors, or one for each of the robot's buses, in order
        *,
        homing_offset: Mapping[str, float] = MappingProxyType({}),
        log: Log = lambda *_: None,
    ) -> None:
        """Power the motors on, see `MockMotors`; `log` is called on the motors' thread."""
        self.addresses = tuple(parse_address(one) if isinstance(one, str) else one for one in addresses)
        self._motors = MockMotors(description, len(self.addresses), homing_offset=homing_offset, log=log)
        with contextlib.ExitStack() as opened:
            self._buses = [opened.enter_context(_open(address)) for address in self.addresses]
            self._opened = opened.pop_all()
        self._origin = time.monotonic()
        self._lock, self._closing = threading.Lock(), threading.Event()
        self.truth: MITState = self._motors.plant.truth(0.0)
        """The true state, at most a few ms old."""
        self.stood_still = 0.0  # s for which this computer was too slow
        self.failure: Exception | None = None  # exception that ended the thread; None while it runs
        self._thread = threading.Thread(target=self._run, name="mock motors", daemon=True)
        self._thread.start()

    def clock(self) -> float:
        """Return s since the motors were powered on: a robot that shares this clock waits for motors that are late."""
        now = time.monotonic() - self._origin
        return min(now, self._motors.time + _MOST_BEHIND) if self._thread.is_alive() else now

    def call(self, action: Callable[[MockMotors], None]) -> None:
        """Change something in the simulation between two of its events."""
        with self._lock:
            action(self._motors)

    def inject(self, fault: Fault) -> None:
        """Schedule a fault, on `clock`."""
        self.call(lambda motors: motors.inject(fault))

    def set_versions(self, versions: Mapping[str, FirmwareVersion]) -> None:
        """Have the motors of these models report other versions of firmware."""
        for motor in self._motors.motors:
            if isinstance(motor, RobstrideMotor):
                motor.version = versions.get(motor.model.name, motor.version)

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        self.call(lambda motors: motors.plant.support.move(held, lifts=lifts))

    @property
    def supported(self) -> bool:
        return self._motors.plant.support.holds

    def close(self) -> None:
        """Stop the thread and close the motors' ends of the channels. Raises what ended the thread."""
        self._closing.set()
        self._thread.join()
        self._opened.close()
        if self.failure is not None:
            raise self.failure

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        next_truth = 0.0
        try:
            while not self._closing.wait(_POLL_PERIOD):
                with self._lock:
                    self._poll()
                    if self._motors.time >= next_truth:
                        self.truth = self._motors.plant.truth(self._motors.time)
                        next_truth = self._motors.time + _TRUTH_PERIOD
        except Exception as error:
            self.failure = error

    def _poll(self) -> None:
        """Take the frames that have come, at the times of their stamps, let time pass, and send what is due."""
        too_late = max(time.monotonic() - self._origin - self._motors.time - _MOST_BEHIND, 0.0)
        self._origin += too_late
        self.stood_still += too_late
        until, wall = time.monotonic() - self._origin, time.time()  # `wall` as python-can stamps
        for index, bus in enumerate(self._buses):
            for _ in range(_MOST_AT_ONCE):
                message = bus.recv(0.0)
                if message is None:
                    break
                # `is_rx` says nothing: on SocketCAN frames of other processes of this machine come without it
                frame = frame_of(message)
                if not (message.is_error_frame or message.is_fd):
                    self._motors.submit(index, frame, until - max(wall - message.timestamp, 0.0))
        for arrival in self._motors.advance(until):
            with contextlib.suppress(can.CanError):  # a channel without a listener takes none
                self._buses[arrival.bus].send(message_of(arrival.frame, wall - until + arrival.time))


def _open(address: BusAddress) -> can.BusABC:
    if address.interface == "virtual":
        return can.Bus(interface="virtual", channel=address.channel, preserve_timestamps=True)
    return open_bus(address)
