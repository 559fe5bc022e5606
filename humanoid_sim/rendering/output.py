"""Files that are either written completely or not at all, and refused before the work starts."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from humanoid_sim.errors import InputError

__all__ = ["check_output", "replacing"]


def check_output(path: str | Path, what: str, suffixes: tuple[str, ...]) -> Path:
    """`path`, if a file with that name can be written. A file that is there will be replaced.

    Raises:
        InputError: the suffix is not one of `suffixes`, or the folder is missing or not writable.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{what} '{path}': suffix is '{path.suffix}', accepted: {', '.join(suffixes)}")
    if path.is_dir():
        raise InputError(f"{what} '{path}': is a folder, expected the name of a file")
    if not path.parent.is_dir():
        raise InputError(f"{what} '{path}': there is no folder '{path.parent}'")
    trial = _temporary_name(path)
    try:
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise InputError(f"{what} '{path}': cannot write to folder '{path.parent}': {error.strerror}") from None
    return path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name in the same folder to write to; it becomes `path` when the block ends, and vanishes if it raises."""
    temporary = _temporary_name(path)
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _temporary_name(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
