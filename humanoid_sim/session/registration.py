"""The file by which others on this machine find a running session; it is locked for as long as the session lives."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from pathlib import Path

from humanoid_sim.client import REPLY_SUFFIX, SUFFIX, SessionError, session_folder
from humanoid_sim.errors import InputError

_SOCKETS = (".intents", ".data")


def made_session_folder() -> Path:
    """Return the folder of this user's sessions, made for its user alone, without what killed sessions left there.

    Raises `InputError` if it cannot be made, or others may enter it.
    """
    try:
        folder = session_folder()
        folder.mkdir(mode=0o700, exist_ok=True)
        session_folder()
    except SessionError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be made: {error.strerror}") from None
    for path in folder.glob(f"*{SUFFIX}"):
        _sweep(path)
    for path in folder.glob(f"*{REPLY_SUFFIX}"):
        _sweep_reply(path)
    return folder


class Registration:
    """Held from `register` to `close`."""

    def __init__(self) -> None:
        """Choose the names of this process's session. Raises `InputError` if there can be none."""
        folder = made_session_folder()
        stem = str(os.getpid())
        self.path = folder / f"{stem}{SUFFIX}"
        self.intents, self.data = (folder / f"{stem}{suffix}" for suffix in _SOCKETS)
        self._handle: int | None = None
        if self.path.exists():  # swept if nobody held it: this process has a session, or one in another namespace
            raise InputError(f"{self.path}: another session has this process id")

    def register(self, *, robot: str, policy: str, hardware: str, feed: Path) -> None:
        """Let others find the session. Raises `InputError` if the file cannot be written."""
        self._told = {
            "process": os.getpid(),
            "robot": robot,
            "policy": policy,
            "folder": os.getcwd(),
            "hardware": hardware,
            "feed": str(feed),
            "intents": str(self.intents),
            "data": str(self.data),
        }
        try:
            self._write()
        except OSError as error:
            self.close()
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None

    def _write(self) -> None:
        temporary, before = self.path.with_name(f".{self.path.name}"), self._handle
        try:
            handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            self._handle = handle
            # Locked before it has its name: nobody ever sees it without.
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with open(handle, "wb", closefd=False) as file:
                file.write(json.dumps(self._told).encode())
            temporary.rename(self.path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise
        if before is not None:
            os.close(before)

    def close(self) -> None:
        """Take the file away. May be called twice."""
        if self._handle is not None:
            self.path.unlink(missing_ok=True)
            os.close(self._handle)
            self._handle = None


def _sweep(path: Path) -> None:
    """Remove what a killed session left."""
    with contextlib.suppress(OSError):
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not os.path.samestat(os.fstat(handle), path.stat()):  # replaced meanwhile
                return
            for left in (*(path.with_suffix(suffix) for suffix in _SOCKETS), path):
                left.unlink(missing_ok=True)
        finally:
            os.close(handle)


def _sweep_reply(path: Path) -> None:
    """Remove the socket for answers of a client that was killed."""
    with contextlib.suppress(OSError, ValueError):
        try:
            os.kill(int(path.name.partition("-")[0]), 0)
        except ProcessLookupError:
            path.unlink(missing_ok=True)
