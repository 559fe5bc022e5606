"""Files of a user: paths looked at before anything opens them, and outputs that exist whole or not at all.

`pathlib` raises where a name is too long for the file system, and opening a pipe or a device waits for a writer that
may never come.
"""

from __future__ import annotations

import io
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import IO, Any

from humanoid_sim.errors import InputError, blaming

try:
    import fcntl

    _HAS_LOCKS = True
except ImportError:  # Windows: nothing tells who else writes a file
    _HAS_LOCKS = False

_SHOWN = 40
"""Characters of a file's name that its temporary one begins with; four bytes each at most, of 255."""
_CLOSE_IN_CHILDREN = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
"""Flags of opening that not every system has, or needs."""
_COUNT = count()


LARGEST = 1 << 30
"""Bytes of a file that is read whole: more than any robot, policy or motion needs."""


def regular_file(path: str | os.PathLike[str], what: str, largest: int | None = LARGEST) -> Path:
    """Return the path of a file that can be read to its end.

    Raises `InputError` if there is no such file, it is a directory, a pipe or a device, or it is too large.

    Args:
        what: it should be, such as `a motion file (.mcap)`.
        largest: bytes; None: its reader takes no more memory for more.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if path.is_file():
            path.open("rb").close()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file, expected {what}") from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not path.is_file():
        kind = "a directory" if path.is_dir() else "a pipe or a device"
        raise InputError(f"{path}: is {kind}, expected {what}")
    if largest is not None and size > largest:
        raise InputError(f"{path}: has {size} bytes, expected {what} of at most {largest}")
    return path


def is_file(path: str | os.PathLike[str]) -> bool:
    """Return whether there is such a regular file; a name that no file can have is not an error."""
    return os.path.isfile(path)


def output_file(path: str | os.PathLike[str], what: str, *suffixes: str, overwrite: bool = True) -> Path:
    """Return the path of a file to write, looked at before the work whose result it will hold.

    Raises `InputError` if its name has another suffix, is taken, or cannot be written.

    Args:
        what: it is, for messages, such as the option that names it.
        suffixes: that its name may have, in lower case; none for any.
        overwrite: replace a file that is there.
    """
    path = Path(path)
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError(f"{what}: is '{path}', expected a name that ends in {' or '.join(suffixes)}")
    with blaming(f"{what}: '{path}' cannot be written", OSError):
        exists = path.exists()
        if path.is_dir():
            raise InputError(f"{what}: '{path}' is a directory, expected a file name")
        if exists and not path.is_file():
            raise InputError(f"{what}: '{path}' is a pipe or a device, expected a file name")
        if exists and not overwrite:
            raise InputError(f"{what}: '{path}' exists; choose another name, or add --overwrite")
        if exists and _is_being_written(path):
            raise InputError(f"{what}: '{path}' {_WRITTEN}")
        if not path.parent.is_dir():
            raise InputError(f"{what}: the folder '{path.parent}' does not exist")
        tempfile.TemporaryFile(dir=path.absolute().parent).close()
    return path


def exclusive_file(path: str | os.PathLike[str], *, overwrite: bool = True) -> io.FileIO:
    """Open a file to be written over a long time, unbuffered and empty; nobody else here writes it meanwhile.

    Raises `InputError` if another process writes it, and it is left alone; it is there, without `overwrite`; or it
    cannot be written.
    """
    path = Path(path)
    flags = os.O_WRONLY | os.O_CREAT | _CLOSE_IN_CHILDREN | (0 if overwrite else os.O_EXCL)
    try:
        file = io.FileIO(os.open(path, flags, 0o666), "wb")
    except FileExistsError:
        reason = _WRITTEN if _is_being_written(path) else "exists; choose another name"
        raise InputError(f"{path}: {reason}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        if _HAS_LOCKS:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            file.truncate(0)
    except BlockingIOError:
        file.close()
        raise InputError(f"{path}: {_WRITTEN}") from None
    except OSError as error:
        file.close()
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    return file


_WRITTEN = "is being written by another session; choose another name"


def _is_being_written(path: Path) -> bool:
    """Return whether somebody has the file from `exclusive_file`."""
    if not _HAS_LOCKS:
        return False
    try:
        with io.FileIO(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Open a new file beside `path`; it takes that name when the block ends, and vanishes if the block raises.

    Raises `InputError` if the file cannot be written; the line names `path` and the reason.
    """
    path = Path(path)
    # The beginning of the name only: with something added to it, a name of full length would be too long.
    temporary = path.with_name(f".{path.name[:_SHOWN]}.{os.getpid()}-{next(_COUNT)}.tmp")
    try:
        if path.is_dir():
            raise IsADirectoryError(None, "is a directory")
        with temporary.open("wb") as file:
            yield file
        if _is_being_written(path):
            raise InputError(f"{path}: {_WRITTEN}")
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):  # whatever kept it from being made keeps it from being removed
            temporary.unlink()


def finite(value: Any) -> Any:
    """Return plain values with null in the place of NaN and infinity, which JSON does not know."""
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, Mapping):
        return {name: finite(item) for name, item in value.items()}
    return [finite(item) for item in value] if isinstance(value, list | tuple) else value
