"""The channels that a robot's or a tool's motors are on: locked, for one process at a time drives them, and open."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import os
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from humanoid_sim.errors import RobotError, blaming
from humanoid_sim.hardware.bus.address import BusAddress, open_bus
from humanoid_sim.hardware.bus.channel import NEVER, Channel, Note, OpenBus
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.checks import CheckList

_SHARED = Path("/tmp")  # of all users, whatever TMPDIR says: two sessions must look in the same folder
_held: set[BusAddress] = set()  # channels of the interface `virtual`, which exist within one process only


class ChannelLock:
    """Holds a channel for this process until `release`, or until the kernel lets go of it when the process has ended.

    `flock` belongs to the open file and not to the process, so two sessions in one process exclude each other as well.
    """

    def __init__(self, address: BusAddress) -> None:
        """Lock the channel; a `RobotError` where another session, which it names, drives it, or no lock can be made."""
        self._address = address
        self.descriptor = -1  # the lock's open file, through which a child process holds it as well; -1: none
        if address.interface == "virtual":
            if address in _held:
                raise RobotError(f"{address}: is in use by another session (of this process)")
            _held.add(address)
            return
        self.descriptor = _open(address)
        try:
            fcntl.flock(self.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.pread(self.descriptor, 200, 0).decode(errors="replace").strip()
            os.close(self.descriptor)
            raise RobotError(f"{address}: is in use by another session ({holder or 'unknown process'})") from None
        # The file stays when the lock goes: a name removed and made again would be two files, and so two locks.
        with contextlib.suppress(OSError):  # a full disk keeps nobody from driving
            os.ftruncate(self.descriptor, 0)
            os.pwrite(self.descriptor, f"process {os.getpid()}, {sys.argv[0] or 'python'}\n".encode(), 0)

    def release(self) -> None:
        """Let others have the channel. May be called twice."""
        _held.discard(self._address)
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def _open(address: BusAddress) -> int:
    """Open the lock's file for any user; first without O_CREAT, which the kernel refuses for another user's file."""
    channel = address.channel
    if channel.startswith("/"):  # the same adapter by another name, such as /dev/serial/by-id/…; `@` begins a bit rate
        channel = os.path.realpath(channel.partition("@")[0])
    name = re.sub(r"[^A-Za-z0-9._-]", "_", f"{address.interface}-{channel}")
    path = (_SHARED if _SHARED.is_dir() else Path(tempfile.gettempdir())) / f"humanoid_sim-can-{name}.lock"
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    with blaming(f"{address}: cannot make its lock {path}", OSError, RobotError):
        try:
            return os.open(path, flags)
        except FileNotFoundError:
            descriptor = os.open(path, flags | os.O_CREAT, 0o666)
            os.fchmod(descriptor, 0o666)  # the umask would shut other users out, and they must see the lock
            return descriptor


def lock_channels(addresses: Sequence[BusAddress], checks: CheckList) -> tuple[ChannelLock, ...]:
    """Lock every channel, or none; a channel that another session holds becomes a problem."""
    locks: list[ChannelLock] = []
    for address in addresses:
        with checks.collecting(address):
            locks.append(ChannelLock(address))
    if len(locks) < len(addresses):
        for lock in locks:
            lock.release()
    return tuple(locks) if len(locks) == len(addresses) else ()


@dataclass(slots=True)
class ChannelNotes:
    """Frames of one channel that belong to none of its motors. Written by its receiver's thread."""

    intruder: Note = NEVER  # the latest sign of another host that commands our motors
    strangers: Counter[str] = field(default_factory=Counter)  # frames that concern none of our motors, by kind

    def seen(self) -> list[str]:
        """Return the strangers' frames: `7 × frame with an 11-bit identifier`."""
        return [f"{count} × {what}" for what, count in self.strangers.items()]


Listener = Callable[[int, Frame, float], bool]
"""Takes a frame with its channel's index and its time (s, robot's clock), on the receiver's thread; True if it knows
the frame, which is then nobody else's."""


class OpenChannels:
    """Channels that are open; a frame goes to the first listener that knows it."""

    def __init__(
        self,
        addresses: Sequence[BusAddress],
        checks: CheckList,
        *,
        clock: Callable[[], float] = time.monotonic,
        open_bus: OpenBus = open_bus,
        locks: Sequence[ChannelLock] = (),
    ) -> None:
        """Open every channel, or none, with a `RobotError` of everything that is wrong."""
        checks.refuse()
        self.locks = tuple(lock.descriptor for lock in locks if lock.descriptor >= 0)  # for a child that sends too
        self.clock = clock
        self.listeners: list[Listener] = []  # in the order in which a frame is offered to them
        self.sources = tuple(str(address) for address in addresses)
        self.channels: tuple[Channel, ...] = ()
        for index, address in enumerate(addresses):
            receive = functools.partial(self._receive, index)
            with checks.collecting(address):
                self.channels = (*self.channels, Channel(address, receive, open_bus=open_bus, clock=clock))
        self.forget_notes()
        if checks.problems:
            self.close()
            checks.refuse()

    def _receive(self, channel: int, frame: Frame, when: float) -> None:
        any(listener(channel, frame, when) for listener in self.listeners)

    def check(self, checks: CheckList) -> None:
        """Report another master, and each channel that is down, as a problem."""
        for source, channel, notes in zip(self.sources, self.channels, self.notes, strict=True):
            if notes.intruder is not NEVER:
                checks.problem(source, f"another master drives these motors: {notes.intruder.text}")
            if channel.down:
                checks.problem(source, f"down: {channel.down}")

    def warn_of_strangers(self, checks: CheckList) -> None:
        """Report frames of other programs, or of motors that speak another protocol."""
        for source, notes in zip(self.sources, self.notes, strict=True):
            for text in notes.seen():
                checks.warn(source, f"{text}: another program, or a motor in another protocol")

    def troubles(self, index: int) -> tuple[str, ...]:
        """Return why nothing may come back on a channel, the most telling first."""
        channel = self.channels[index]
        texts = [channel.down, channel.tx_full.text, channel.error.text, *self.notes[index].seen()]
        return tuple(filter(None, texts))

    def forget_queues(self) -> None:
        """Drop frames that wait to be sent: after a jam, a stop must not stand behind them."""
        for channel in self.channels:
            channel.forget_queue()

    def forget_notes(self) -> None:
        """Forget frames that belong to no motor."""
        self.notes = tuple(ChannelNotes() for _ in self.channels)

    def close(self) -> None:
        """Close all channels. May be called twice."""
        for channel in self.channels:
            channel.close()
