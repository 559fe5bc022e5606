"""The loop's end of its guardian: starts it, shows it signs of life, and gives way once it has taken over."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import can
import msgspec

import humanoid_sim
from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import BusAddress, PassingBus
from humanoid_sim.hardware.bus.channel import OpenBus
from humanoid_sim.hardware.guardian import process
from humanoid_sim.hardware.guardian.protocol import GuardianPlan, Heartbeat, Phase, Stage
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus

SOURCE = "guardian"
_START = 10.0
"""s that it may take to start, on a busy computer."""
_DEAF = 0.5
"""s without a look of the guardian's after which it counts as deaf; its death is noticed at once."""
_END = 1.0
"""s that it may take to end, beyond what its plan takes."""
_WITHIN_PROCESS = "virtual"


def can_share(channel: BusAddress) -> bool:
    """Return whether a guardian can reach a channel.

    One of the interface `virtual` exists within one process only, and motors that are emulated there end with it.
    """
    return channel.interface != _WITHIN_PROCESS


class Guardian:
    """A guardian that watches this process, from construction until `release`. Of its methods none but these two waits.

    The loop opens the guarded channels through `open_bus`, says `standby` before it enables a motor, and `beat` with
    every set of commands.
    """

    def __init__(self, plan: GuardianPlan, locks: Sequence[int] = ()) -> None:
        """Start it, and wait until it watches; a `RobotError` if it does not start, or cannot open a channel.

        Args:
            plan: what it is to do; its channels must be ones that it can share.
            locks: descriptors of the channels' locks, which it holds as well.
        """
        self._plan = plan
        self._channels = plan.channels
        self._heartbeat = Heartbeat.create(len(self._channels))
        self._looks, self._looked = -1, time.monotonic()
        self._has_ended = False
        self.measures = ""
        """Measures for timely scheduling that it was granted."""
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", process.__name__, *map(str, (self._heartbeat.descriptor, *locks))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=(self._heartbeat.descriptor, *locks),
                start_new_session=True,  # a terminal's signals and its end are not for the guardian
                env=_environment(),
            )
        except OSError as error:
            self._heartbeat.close()
            raise RobotError(f"the guardian cannot be started: {error.strerror}") from None
        try:
            self.measures = self._await_ready()
        except BaseException:
            self._process.kill()
            self._reap()
            raise
        self._looks, self._looked = self._heartbeat.looks, time.monotonic()

    def _await_ready(self) -> str:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        line = b""
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(msgspec.json.encode(self._plan) + b"\n")
            self._process.stdin.flush()
        if select.select([self._process.stdout], [], [], _START)[0]:
            line = self._process.stdout.readline()
        word, _, rest = line.decode(errors="replace").strip().partition(": ")
        if word != process.READY:
            why = rest if word == "error" else word or f"no answer within {_START:g} s"
            raise RobotError(f"the guardian does not start: {why}")
        return rest

    @property
    def pid(self) -> int:
        """Return the id of its process."""
        return self._process.pid

    # --- the channels

    def opener(self, open_bus: OpenBus) -> OpenBus:
        """Return what opens channels so that the guardian sees what leaves, and so that nothing leaves beside it."""

        def open_watched(address: BusAddress) -> can.BusABC:
            index = self._channels.index(address) if address in self._channels else None
            return _WatchedBus(open_bus(address), address, self, index)

        return open_watched

    @property
    def drives(self) -> bool:
        """Return whether the motors are the guardian's: it has taken over, and has not ended."""
        return self.has_taken_over and not self._has_ended

    @property
    def has_taken_over(self) -> bool:
        """Return whether it has ever taken over."""
        return self._heartbeat.descriptor >= 0 and self._heartbeat.stage >= Stage.DAMPING

    def count_sent(self, index: int) -> None:
        """Count a frame that has left on one of its channels."""
        if not self._has_ended:
            self._heartbeat.count_sent(index)

    # --- the loop

    def standby(self) -> None:
        """From here on motors may be enabled, without torque: the end of this process makes the guardian act."""
        self._heartbeat.phase = Phase.STANDBY

    def beat(self) -> None:
        """Note that a set of commands was decided: from here on silence makes the guardian act."""
        if self._has_ended:
            return
        self._heartbeat.beat()
        if not self.has_taken_over:
            self._heartbeat.phase = Phase.ARMED

    def status(self) -> SafetyStatus | None:
        """Return what is wrong with it, or that it has taken over; none while it watches."""
        if self._has_ended:
            return None
        if self.has_taken_over:
            self._heartbeat.phase = Phase.DISPLACED
            return SafetyStatus(
                SafetyLevel.FAULT,
                SafetyFlag.NONE,
                SOURCE,
                "the guardian has taken over, because this program was silent: it damps and resets the motors, and no "
                "command leaves; reactivate, or end",
            )
        now, looks = time.monotonic(), self._heartbeat.looks
        if looks != self._looks:
            self._looks, self._looked = looks, now
        has_died = self._process.poll() is not None
        if not has_died and now - self._looked <= _DEAF:
            return None
        names = ", ".join(motor.name for motor in self._plan.motors)
        what = "has died" if has_died else "does not answer"
        return SafetyStatus(
            SafetyLevel.WARNING,
            SafetyFlag.NONE,
            SOURCE,
            f"the guardian {what}: were this program to die, nobody would stop {names}; reactivate",
        )

    # --- the end

    def release(self, *, confirmed: bool) -> None:
        """End it and wait for that: at once if its motors are `confirmed` to be off, else after braking them."""
        if self._has_ended:
            return
        if self._heartbeat.phase is not Phase.IDLE:
            self._heartbeat.phase = Phase.RELEASED if confirmed else Phase.ABANDONED
        longest = self._plan.damping_time + self._plan.period * self._plan.reset_rounds + _END
        with contextlib.suppress(subprocess.TimeoutExpired):
            if self._heartbeat.phase is not Phase.IDLE:
                self._process.wait(longest)
        self._reap()

    def _reap(self) -> None:
        """Close its pipe, which ends one that has nothing to do; one that does not end is killed."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.stdout.close()
        try:
            self._process.wait(_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._has_ended = True
        self._heartbeat.close()


def _environment() -> dict[str, str]:
    """Return this process's, with the package where this one has found it."""
    root = str(Path(humanoid_sim.__file__).parents[1])
    known = os.environ.get("PYTHONPATH")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([root, known] if known else [root])}


class _WatchedBus(PassingBus):
    """Counts what leaves, and refuses to send once the guardian drives."""

    def __init__(self, bus: can.BusABC, address: BusAddress, guardian: Guardian, index: int | None) -> None:
        super().__init__(bus, str(address))
        self._guardian = guardian
        self._index = index

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send, or raise `can.CanOperationError` where the guardian drives."""
        if self._guardian.drives:
            raise can.CanOperationError("the guardian has taken over", errno.ESHUTDOWN)
        super().send(msg, timeout)
        if self._index is not None:
            self._guardian.count_sent(self._index)
