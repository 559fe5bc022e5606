"""One process at a time drives a channel: an advisory file lock that the kernel releases however its holder ends."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import sys
import tempfile
import threading
from pathlib import Path
from typing import Self

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import BusAddress

_SHARED = Path("/tmp")
"""The same for every user and every TMPDIR: two sessions that look in different folders would both drive the robot."""

_WITHIN_PROCESS = "virtual"
_held: set[BusAddress] = set()
"""Virtual channels in use."""
_guard = threading.Lock()


class ChannelLock:
    """Holds a channel for this process until `release`, the end of the process, or its death.

    `flock` belongs to the open file and not to the process, so two sessions in one process exclude each other as well.
    A channel of the interface `virtual` exists within one process only, and its lock is not a file.
    """

    def __init__(self, address: BusAddress) -> None:
        """Take the channel.

        Raises:
            RobotError: another session drives it (the message names its process), or the lock cannot be made.
        """
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
    try:
        try:
            return os.open(path, flags)
        except FileNotFoundError:
            descriptor = os.open(path, flags | os.O_CREAT, 0o666)
            os.fchmod(descriptor, 0o666)  # the umask would shut other users out, and they must see the lock
            return descriptor
    except OSError as error:
        raise RobotError(f"{address}: cannot make its lock {path}: {error.strerror}") from None


def _program() -> str:
    """Return what this process runs, in a word: the package's name where it was started by `python -m`."""
    path = Path(sys.argv[0])
    return (path.parent.name if path.name == "__main__.py" else path.name) or "python"
