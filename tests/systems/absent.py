"""As on a system without them: modules, sockets, scheduling and symbolic links that only Unix, or only Linux, has.

Run with a program's words after it: `python absent.py CODE`.
"""

import os
import signal
import socket
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec

MODULES = ("fcntl", "grp", "pwd", "resource", "termios", "tty")
OF_OS = (
    "sched_", "SCHED_", "memfd_", "MFD_", "posix_", "getuid", "geteuid", "fork",
    "O_CLOEXEC", "O_NONBLOCK", "O_NOFOLLOW",
)  # fmt: skip
OF_SIGNAL = ("SIGHUP", "SIGQUIT", "SIGTSTP", "SIGKILL")


class Absent:
    """Finds that a module is not there."""

    @staticmethod
    def find_spec(name: str, *_: object) -> ModuleSpec | None:
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)
        return None


def no_link(*_: object, **__: object) -> None:
    raise OSError(1314, "A required privilege is not held by the client")


def hide(words: Sequence[str] = MODULES) -> None:
    """Take it all away."""
    sys.meta_path.insert(0, Absent)
    for name in words:
        sys.modules.pop(name, None)
    del socket.AF_UNIX
    for name in [name for name in dir(os) if name.startswith(OF_OS)]:
        delattr(os, name)
    for name in OF_SIGNAL:
        delattr(signal, name)
    os.symlink = no_link  # type: ignore[assignment]


if __name__ == "__main__":
    import asyncio  # noqa: F401 - the standard library's own parts for Unix are not what is tested
    import multiprocessing  # noqa: F401
    import subprocess  # noqa: F401
    import tempfile  # noqa: F401

    hide()
    exec(compile(sys.argv[1], "<what is tried>", "exec"), {"__name__": "__main__"})
