"""Files that exist whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import IO

from humanoid_sim.errors import InputError

__all__ = ["whole_file"]

_SHOWN = 40
"""Characters of a file's name that its temporary one begins with; four bytes each at most, of 255."""
_COUNT = count()


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Open a new file beside `path`; it takes that name when the block ends, and vanishes if the block raises.

    Raises:
        InputError: if the file cannot be written; the line names `path` and the reason.
    """
    path = Path(path)
    # The beginning of the name only: with something added to it, a name of full length would be too long.
    temporary = path.with_name(f".{path.name[:_SHOWN]}.{os.getpid()}-{next(_COUNT)}.tmp")
    try:
        if path.is_dir():
            raise IsADirectoryError(None, "is a directory")
        with temporary.open("wb") as file:
            yield file
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):  # whatever kept it from being made keeps it from being removed
            temporary.unlink()
