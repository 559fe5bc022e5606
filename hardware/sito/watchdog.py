"""A child process that brakes motors without a timeout of their own when the loop's process dies or falls silent.

Loop and child share a socket. The loop sends ENABLED before a motor may be enabled, BEAT with every set of commands
that left, and RELEASED at the end. The child is idle, then armed, then released. After a timeout without a BEAT, or
when the socket closes before RELEASED, it sends TAKEN, damps the motors for 3 s and resets them. A loop that resumes
finds TAKEN, answers SEEN and sends nothing more.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import can
import msgspec

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.can_bus import BusAddress, Frame, message_of, open_bus
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.session.realtime import real_time

SOURCE = "watchdog"
TIMEOUT = 0.1  # s without a beat after which the child takes over
DAMPING_TIME = 3.0  # s of damping before the motors are reset, as at the end of a session: the arms sink meanwhile
_PERIOD = 0.02  # s between two rounds of frames
_RESETS = 5  # rounds in which the reset is sent
_REMINDER = 0.2  # s between further ones, until a stopped loop has seen TAKEN: one last frame of its own may leave
_START = 10.0  # s that the child may take to start, on a busy computer
_END = 1.0  # s that the child may take to end, beyond what it has to send
ENABLED, BEAT, RELEASED, SEEN, TAKEN = b"e", b"b", b"r", b"s", b"t"


@dataclass(frozen=True, slots=True)
class WatchedMotor:
    """A motor and the frames that brake it. They must be harmless whatever was commanded, also where one is lost."""

    name: str
    channel: BusAddress
    damping: tuple[Frame, ...]  # sent together, every period
    reset: tuple[Frame, ...]  # sent after the damping


class Watchdog:
    """The loop's end. Only the construction and `release` wait."""

    def __init__(self, motors: Sequence[WatchedMotor], locks: Sequence[int] = ()) -> None:
        """Start the child, and wait until it watches. Raises `RobotError` if it does not.

        The channels are ones that another process can reach; the child holds the open files that lock them as well.
        """
        self._names = ", ".join(motor.name for motor in motors)
        self._socket, theirs = socket.socketpair()
        self._has_taken_over = self._has_died = False
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno())],
                stdin=subprocess.PIPE,
                pass_fds=(theirs.fileno(), *locks),
                start_new_session=True,  # a terminal's signals and its end are not for the child
                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            )
        self.pid = self._process.pid
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError), self._process.stdin as plan:
            plan.write(msgspec.json.encode((motors, DAMPING_TIME)))
        is_answered = select.select([self._socket], [], [], _START)[0]
        answer = _received(self._socket) if is_answered else b"no answer"
        if answer != BEAT:
            self._reap(0.0)
            raise RobotError(f"the watchdog does not start: {(answer or b'it has ended').decode()}")

    def enabled(self) -> None:
        """Arm without a deadline: motors may be enabled without torque, and only the end of this process counts."""
        self._send(ENABLED)

    def beat(self) -> None:
        """Report a set of commands that has left: from here on silence counts."""
        self._send(BEAT)

    def poll(self) -> bool:
        """Return whether the loop may send: the child has not taken over."""
        data = _received(self._socket)
        if data is not None and TAKEN in data:
            self._has_taken_over = True
            self._send(SEEN)
        self._has_died = data == b""
        return not self._has_taken_over

    def status(self) -> SafetyStatus | None:
        """Return what is wrong: the child has taken over, or has died."""
        level, text = SafetyLevel.WARNING, f"the watchdog has died: nothing would stop {self._names}; reactivate"
        if not self.poll():
            level = SafetyLevel.FAULT
            text = "this program was silent: the watchdog damps and resets the motors; no command leaves; reactivate"
        elif not self._has_died:
            return None
        return SafetyStatus(level, SafetyFlag.NONE, SOURCE, text)

    def release(self, *, confirmed: bool) -> None:
        """End the child: at once if its motors are `confirmed` to be off, else after it has braked them."""
        if confirmed:
            self._send(RELEASED)
        is_braking = self._has_taken_over or not confirmed
        self._reap(DAMPING_TIME + _PERIOD * _RESETS + _END if is_braking else _END)

    def _send(self, message: bytes) -> None:
        with contextlib.suppress(OSError):  # a child that is gone shows in `status`
            self._socket.send(message)

    def _reap(self, patience: float) -> None:
        self._socket.close()
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _received(end: socket.socket) -> bytes | None:
    """Return what has come; None: nothing yet, empty: the other end is gone."""
    try:
        return end.recv(4096, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None
    except OSError:
        return b""


# --- the child


def main(descriptor: int) -> int:
    """Watch until the loop releases or is gone; returns the exit status."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)
    loop = socket.socket(fileno=descriptor)
    plan = sys.stdin.buffer.read()
    motors, damping_time = msgspec.json.decode(plan, type=tuple[tuple[WatchedMotor, ...], float])
    with contextlib.ExitStack() as opened:
        try:
            buses = {one: opened.enter_context(open_bus(one)) for one in {motor.channel for motor in motors}}
        except RobotError as error:
            loop.send(str(error).encode())
            return 1
        opened.enter_context(real_time(ahead=10))  # it runs before the loop
        loop.send(BEAT)
        reason = _watch(loop)
        if not reason:
            return 0
        with contextlib.suppress(OSError):  # before any frame: a loop that resumes must not send
            loop.send(TAKEN)
        names = ", ".join(motor.name for motor in motors)
        with contextlib.suppress(OSError):  # stderr may be gone
            os.write(2, f"watchdog: {reason}: damping {names} for {damping_time:g} s, then reset\n".encode())
        for _ in range(math.ceil(damping_time / _PERIOD)):
            _send_all(buses, [(motor.channel, motor.damping) for motor in motors])
            time.sleep(_PERIOD)
        resets = 0
        while resets < _RESETS or not _has_seen(loop):
            _send_all(buses, [(motor.channel, motor.reset) for motor in motors])
            resets += 1
            time.sleep(_PERIOD if resets <= _RESETS else _REMINDER)
    return 0


def _watch(loop: socket.socket) -> str:
    """Return why the motors have to be braked; empty: they need not."""
    is_armed, deadline = False, math.inf
    while True:
        if not select.select([loop], [], [], min(max(deadline - time.monotonic(), 0.0), 1.0))[0]:
            if time.monotonic() >= deadline:
                return f"no command has left for {1000.0 * TIMEOUT:.0f} ms"
            continue  # a child that was held up finds the loop's beats here first
        data = _received(loop) or b""
        if RELEASED in data:
            return ""
        if not data:
            return "the loop has ended" if is_armed else ""
        is_armed = True
        deadline = time.monotonic() + TIMEOUT if data.endswith(BEAT) else math.inf


def _has_seen(loop: socket.socket) -> bool:
    """Return whether the loop has seen TAKEN, or is gone."""
    data = _received(loop)
    return data is not None and (not data or SEEN in data or RELEASED in data)


def _send_all(buses: Mapping[BusAddress, can.BusABC], frames: Iterable[tuple[BusAddress, tuple[Frame, ...]]]) -> None:
    for channel, group in frames:
        for frame in group:
            with contextlib.suppress(Exception):  # a bus that fails must not keep the others from being damped
                buses[channel].send(message_of(frame), _PERIOD)


if __name__ == "__main__":  # started by `Watchdog`, never by hand
    sys.exit(main(int(sys.argv[1])))
