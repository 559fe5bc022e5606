"""The guardian's own process: it watches the heartbeat, and brakes the motors when that stands still.

It imports little and decides little, so that there is little in it that could fail: no NumPy, no family of motors. It
ignores the terminal's signals, because those are the loop's to obey; it holds the locks of the channels as well, so
that no other session begins while it sends; and it runs before the loop where SCHED_FIFO is permitted.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Mapping, Sequence

import can
import msgspec

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import BusAddress, open_bus
from humanoid_sim.hardware.bus.frame import Frame, message_of
from humanoid_sim.hardware.guardian.protocol import GuardianPlan, Heartbeat, Phase, Stage
from humanoid_sim.session.realtime import real_time

READY = "ready"
"""Word that it says once it watches."""
_LOOK = 0.005
"""s between two looks at the heartbeat."""
_AHEAD = 10
"""Priority before the loop's."""
_REMINDER = 0.2
"""s between two resets for as long as the loop may come back and send a last frame."""
_INPUT = 0
_IGNORED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP, signal.SIGPIPE)


class Silence:
    """Tells which sign of life stands still, and since when."""

    def __init__(self, timeout: float, names: Sequence[str]) -> None:
        """Begin at the first look; `names` say what stands still, one per counter."""
        self._timeout = timeout
        self._names = names
        self._last: tuple[int, ...] = ()
        self._since = [math.inf] * len(names)

    def look(self, counters: tuple[int, ...], now: float) -> str:
        """Return what has stood still for too long, in words; empty: nothing."""
        if not self._last:
            self._since = [now] * len(counters)
        for i, (old, new) in enumerate(zip(self._last, counters, strict=False)):
            if new != old:
                self._since[i] = now
        self._last = counters
        silent = [name for name, since in zip(self._names, self._since, strict=True) if now - since >= self._timeout]
        return f"{', '.join(silent)} for {1000.0 * self._timeout:.0f} ms" if silent else ""

    def forget(self) -> None:
        """Forget what was seen so far."""
        self._last = ()


class _Guardian:
    """The process's work, once everything is open."""

    def __init__(self, plan: GuardianPlan, heartbeat: Heartbeat, buses: Mapping[BusAddress, can.BusABC]) -> None:
        self._plan = plan
        self._heartbeat = heartbeat
        self._buses = buses
        self._is_orphan = False
        self._failures = 0
        names = ["no command was decided", *(f"nothing left on {channel}" for channel in plan.channels)]
        self._silence = Silence(plan.timeout, names)

    def watch(self) -> str:
        """Until it is to take over, with the reason; empty: until it is to end."""
        heartbeat = self._heartbeat
        heartbeat.stage = Stage.WATCHING
        while True:
            heartbeat.look()
            phase, now = heartbeat.phase, time.monotonic()
            if phase is Phase.RELEASED:
                return ""
            if phase is Phase.ABANDONED:
                return "motors did not confirm that they are disabled"
            if self._is_orphan:
                return "" if phase is Phase.IDLE else "the process of the loop has ended"
            if phase is Phase.ARMED:
                if reason := self._silence.look(heartbeat.signs_of_life, now):
                    return reason
            else:
                self._silence.forget()
            self.pause(_LOOK)

    def pause(self, duration: float) -> None:
        """Wait, s; shorter if the loop's process ends meanwhile, which closes the pipe on our standard input."""
        if self._is_orphan:
            time.sleep(duration)
        elif select.select([_INPUT], [], [], duration)[0] and not os.read(_INPUT, 1):
            self._is_orphan = True

    def take_over(self) -> None:
        """Damp, then reset; resets go on until a loop that was stopped has seen it: one last frame may leave before."""
        plan, heartbeat = self._plan, self._heartbeat
        heartbeat.stage = Stage.DAMPING  # before anything is sent: a loop that comes back must not send
        self._rounds(max(math.ceil(plan.damping_time / plan.period), 1), lambda motor: motor.damping)
        heartbeat.stage = Stage.RESET
        self._rounds(plan.reset_rounds, lambda motor: motor.reset)
        while not self._is_orphan and heartbeat.phase not in {Phase.RELEASED, Phase.ABANDONED}:
            if heartbeat.phase is not Phase.DISPLACED:
                self._rounds(1, lambda motor: motor.reset)
            heartbeat.look()
            self._sleep_until(time.monotonic() + _REMINDER)

    def _rounds(self, count: int, frames: Callable[..., tuple[Frame, ...]]) -> None:
        due = time.monotonic()
        for _ in range(count):
            self._heartbeat.look()
            for motor in self._plan.motors:
                for frame in frames(motor):
                    self._send(self._buses[motor.channel], frame)
            due += self._plan.period
            self._sleep_until(due)

    def _sleep_until(self, due: float) -> None:
        while (left := due - time.monotonic()) > 0.0:
            self.pause(left)

    def _send(self, bus: can.BusABC, frame: Frame) -> None:
        try:
            bus.send(message_of(frame), self._plan.period)
        except Exception as error:  # a bus that fails must not keep the others from being told
            self._failures += 1
            if self._failures == 1:
                tell(f"a frame could not be sent: {error}")


def tell(text: str) -> None:
    """One line on stderr, which may be gone."""
    with contextlib.suppress(OSError):
        os.write(2, f"guardian: {text}\n".encode())


def main(arguments: Sequence[str]) -> int:
    """Watch until the loop releases it or is gone; the exit status.

    Args:
        arguments: descriptors of the shared memory, then of the channels' locks. The plan is a line on standard input,
            which stays open as long as the loop's process lives.
    """
    for number in _IGNORED:
        signal.signal(number, signal.SIG_IGN)
    memory, *locks = map(int, arguments)
    plan = msgspec.json.decode(_first_line(), type=GuardianPlan)
    heartbeat = Heartbeat(memory, len(plan.channels))
    with contextlib.ExitStack() as left:
        left.callback(heartbeat.close)
        buses: dict[BusAddress, can.BusABC] = {}
        try:
            for channel in plan.channels:
                buses[channel] = bus = open_bus(channel)
                left.callback(bus.shutdown)
                bus.set_filters([{"can_id": 0x1FFFFFFF, "can_mask": 0x1FFFFFFF, "extended": True}])  # it only sends
        except RobotError as error:
            _say(f"error: {error}")
            return 1
        measures = left.enter_context(real_time(ahead=_AHEAD))
        guardian = _Guardian(plan, heartbeat, buses)
        _say(f"{READY}: {'; '.join(measures)}")
        reason = guardian.watch()
        if reason:
            names = ", ".join(motor.name for motor in plan.motors)
            _sign(locks)
            tell(f"{reason}: damping {names} for {plan.damping_time:g} s, then reset")
            guardian.take_over()
            tell(f"damped and reset: {names}")
    return 0


def _first_line() -> bytes:
    text = b""
    while not text.endswith(b"\n"):
        read = os.read(_INPUT, 65536)
        if not read:
            sys.exit(1)  # the loop's process ended before it had enabled anything
        text += read
    return text


def _say(line: str) -> None:
    """To the loop, which waits for it."""
    with contextlib.suppress(OSError):
        os.write(1, f"{line}\n".encode())


def _sign(locks: Sequence[int]) -> None:
    """Tell whoever finds a channel locked who holds it now."""
    for descriptor in locks:
        with contextlib.suppress(OSError):
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"process {os.getpid()}, guardian, which brakes motors\n".encode(), 0)


if __name__ == "__main__":  # started by whoever drives motors that need a guardian, never by hand
    sys.exit(main(sys.argv[1:]))
