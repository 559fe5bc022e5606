"""Paths from a user, looked at before anything opens them.

`pathlib` raises where a name is too long for the file system, and opening a pipe or a device waits for a writer that
may never come.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from humanoid_sim.errors import InputError

__all__ = ["is_file", "regular_file"]


def regular_file(path: str | os.PathLike[str], what: str) -> Path:
    """The path of a file that can be opened and read to its end.

    Args:
        path: of the file.
        what: it should be, such as `a motion file (.mcap)`.

    Raises:
        InputError: there is no such file, or it is a directory, a pipe, a socket or a device.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise InputError(f"{path}: no such file, expected {what}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:  # a null character in the name
        raise InputError(f"{path}: is no name of a file, expected {what}") from None
    if stat.S_ISDIR(mode):
        raise InputError(f"{path}: is a directory, expected {what}")
    if not stat.S_ISREG(mode):
        raise InputError(f"{path}: is a pipe or a device, expected {what}")
    return path


def is_file(path: str | os.PathLike[str]) -> bool:
    """Whether there is such a regular file; a name that no file can have is no error."""
    return os.path.isfile(path)
