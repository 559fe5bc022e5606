"""The folder by which other programs on this machine find a running session; it is locked for as long as it lives."""

from __future__ import annotations

import fcntl
import json
import os
import shutil

from humanoid_sim.client import LOCK, SessionError, is_locked, session_folder
from humanoid_sim.errors import blaming


class Registration:
    """This process's folder, from its creation to `close`, which removes it."""

    def __init__(self) -> None:
        """Make the folder, and remove those of killed sessions.

        Raises `InputError` if it cannot be made, or others may enter it.
        """
        with blaming("the folder of the session's sockets", (SessionError, OSError)):
            folder = session_folder()
            folder.mkdir(mode=0o700, exist_ok=True)
            session_folder()  # refuses one that others may enter
            with open(folder / LOCK, "wb") as creating:  # nobody sweeps a folder that is not locked yet
                fcntl.flock(creating, fcntl.LOCK_EX)
                for path in folder.glob("*/"):
                    if not is_locked(path):
                        shutil.rmtree(path, ignore_errors=True)
                self.path = folder / str(os.getpid())
                self.path.mkdir(mode=0o700)
                self._lock = open(self.path / LOCK, "wb")  # noqa: SIM115 - held until `close`
                fcntl.flock(self._lock, fcntl.LOCK_EX)

    def register(self, *, robot: str, policy: str, hardware: str) -> None:
        fields = {"process": os.getpid(), "robot": robot, "policy": policy, "folder": os.getcwd(), "hardware": hardware}
        (self.path / "session.json").write_text(json.dumps(fields), encoding="utf-8")

    def close(self) -> None:
        if not self._lock.closed:
            shutil.rmtree(self.path, ignore_errors=True)
            self._lock.close()
