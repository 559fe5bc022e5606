"""The channels that a robot's or a tool's motors are on: locked, for one process at a time drives them, and open."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import os
import re
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

from humanoid_sim.errors import RobotError, blaming
from humanoid_sim.hardware.bus.address import BusAddress, bus_hints, open_bus
from humanoid_sim.hardware.bus.channel import Channel, OpenBus
from humanoid_sim.hardware.bus.events import BusEvent, ChannelNotes
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.checks import CheckList

_SHARED = Path("/tmp")
"""Folder of all users, whatever TMPDIR says: two sessions that look in different folders would both drive the robot."""

_WITHIN_PROCESS = "virtual"
_held: set[BusAddress] = set()
"""Virtual channels in use."""
_guard = threading.Lock()


class ChannelLock:
    """Holds a channel for this process until `release`, or until the kernel lets go of it when the process has ended.

    `flock` belongs to the open file and not to the process, so two sessions in one process exclude each other as well.
    A channel of the interface `virtual` exists within one process only, and its lock is not a file.
    """

    def __init__(self, address: BusAddress) -> None:
        """Take the channel; a `RobotError` where another session, which it names, drives it, or no lock can be made."""
        self._address = address
        self._descriptor = -1
        self._is_released = False
        if address.interface == _WITHIN_PROCESS:
            with _guard:
                if address in _held:
                    raise RobotError(f"{address}: is in use by another session (of this process)")
                _held.add(address)
            return
        self._descriptor = _open(_lock_path(address), address)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.pread(self._descriptor, 200, 0).decode(errors="replace").strip()
            os.close(self._descriptor)
            raise RobotError(f"{address}: is in use by another session ({holder or 'unknown process'})") from None
        # The file stays when the lock goes: a name removed and made again would be two files, and so two locks.
        with contextlib.suppress(OSError):  # a full disk keeps nobody from driving; the next one is told less
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, f"process {os.getpid()}, {_program()}\n".encode(), 0)

    @property
    def descriptor(self) -> int:
        """Return the lock's open file, through which a child process holds it as well; -1 where it is not a file."""
        return self._descriptor

    def release(self) -> None:
        """Let others have the channel. May be called twice."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, 0)
            os.close(self._descriptor)
            self._descriptor = -1
        elif self._address.interface == _WITHIN_PROCESS and not self._is_released:
            _held.discard(self._address)
        self._is_released = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def _lock_path(address: BusAddress) -> Path:
    folder = _SHARED if _SHARED.is_dir() else Path(tempfile.gettempdir())
    channel = address.channel
    if channel.startswith("/"):  # the same adapter by another name, such as /dev/serial/by-id/…; `@` begins a bit rate
        channel = os.path.realpath(channel.partition("@")[0])
    name = re.sub(r"[^A-Za-z0-9._-]", "_", f"{address.interface}-{channel}")
    return folder / f"humanoid_sim-can-{name}.lock"


def _open(path: Path, address: BusAddress) -> int:
    """Open the lock's file for any user; first without O_CREAT, which the kernel refuses for another user's file."""
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    with blaming(f"{address}: cannot make its lock {path}", OSError, RobotError):
        try:
            return os.open(path, flags)
        except FileNotFoundError:
            descriptor = os.open(path, flags | os.O_CREAT, 0o666)
            os.fchmod(descriptor, 0o666)  # the umask would shut other users out, and they must see the lock
            return descriptor


def _program() -> str:
    """Return what this process runs, in a word: the package's name where it was started by `python -m`."""
    path = Path(sys.argv[0])
    return (path.parent.name if path.name == "__main__.py" else path.name) or "python"


Listener = Callable[[int, Frame, float], bool]
"""Takes a frame with its channel's index and its time (s, robot's clock), on the receiver's thread; whether it knows
the frame, which is then nobody else's."""

_POLL = 0.001
"""s"""
_PATIENCE = 0.8
"""Share of a control period after which a queue that refused a frame must be empty again."""


class Locks:
    """Some channels for this program alone: a robot's from its first activation until it is closed."""

    def __init__(self) -> None:
        self._held: list[ChannelLock] = []

    def take(self, addresses: Sequence[BusAddress], checks: CheckList) -> None:
        """Lock every channel, or none; a channel that another session holds becomes a problem."""
        if self._held:
            return
        for address in addresses:
            try:
                self._held.append(ChannelLock(address))
            except RobotError as error:
                checks.problem(str(address), str(error).removeprefix(f"{address}: "))
        if len(self._held) < len(addresses):
            self.release()

    @property
    def descriptors(self) -> tuple[int, ...]:
        """Return the locks' open files, see `ChannelLock.descriptor`; locks without a file are left out."""
        return tuple(lock.descriptor for lock in self._held if lock.descriptor >= 0)

    def release(self) -> None:
        """Let others have the channels. May be called twice."""
        for lock in self._held:
            lock.release()
        self._held.clear()


class OpenChannels:
    """Channels that are open; a frame goes to the first listener that knows it."""

    def __init__(
        self,
        addresses: Sequence[BusAddress],
        bursts: Sequence[int],
        checks: CheckList,
        *,
        clock: Callable[[], float] = time.monotonic,
        open_bus: OpenBus = open_bus,
        period: float = 0.02,
    ) -> None:
        """Open every channel, if nothing was wrong before.

        Raises `RobotError` with everything that is wrong; no channel is open then.

        Args:
            bursts: frames that a control period puts into each channel's queue at once.
            clock: the robot's clock, s.
            period: s between commands.
        """
        checks.refuse()
        self.clock = clock
        """s, the robot's."""
        self.opened = clock()
        self.listeners: list[Listener] = []
        """In the order in which they are asked."""
        self.sources = tuple(str(address) for address in addresses)
        opened: list[Channel] = []
        for index, (address, burst) in enumerate(zip(addresses, bursts, strict=True)):
            try:
                receive = functools.partial(self._receive, index)
                opened.append(Channel(address, receive, open_bus=open_bus, clock=clock, patience=_PATIENCE * period))
            except RobotError as error:
                checks.problem(str(address), str(error).removeprefix(f"{address}: "))
                continue
            for hint in bus_hints(address, burst):
                checks.warn(str(address), hint)
        self.channels = tuple(opened)
        self.forget_notes()
        if checks.problems:
            self.close()
            checks.refuse()

    def _receive(self, channel: int, frame: Frame, when: float) -> None:
        any(listener(channel, frame, when) for listener in self.listeners)

    def check_intruders(self, checks: CheckList) -> None:
        """Report another master of the motors on a channel as a problem."""
        for source, notes in zip(self.sources, self.notes, strict=True):
            if notes.intrusions:
                checks.problem(source, f"another master drives these motors: {notes.intruder.text}")

    def check(self, checks: CheckList) -> None:
        """Report another master, and each channel that is down, as a problem."""
        self.check_intruders(checks)
        for source, channel in zip(self.sources, self.channels, strict=True):
            if channel.down:
                checks.problem(source, f"down: {channel.down}")

    def troubles(self, index: int) -> tuple[str, ...]:
        """Return what a channel itself says about why nothing comes back, the most telling first."""
        channel = self.channels[index]
        kinds = (BusEvent.TX_FULL, BusEvent.ERROR, BusEvent.UNREADABLE)
        texts = (channel.down, *(channel.recent(event, self.opened) for event in kinds))
        return tuple(text for text in texts if text)

    def wait(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait for what the receivers hear, `timeout` s at most; whether it came."""
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                return False
            time.sleep(_POLL)
        return True

    def forget_queues(self) -> None:
        """Drop what waits to be sent: after a jam, what comes next must not stand behind what is no longer wanted."""
        for channel in self.channels:
            channel.forget_queue()

    def forget_notes(self) -> None:
        """Forget frames that belong to no motor."""
        self.notes = tuple(ChannelNotes() for _ in self.channels)

    def forget_events(self) -> None:
        """Drop past events of every channel."""
        for channel in self.channels:
            channel.forget_events()

    def close(self) -> None:
        """Close all channels. May be called twice."""
        for channel in self.channels:
            channel.close()
