"""Files of a user: paths checked before anything opens them, and outputs that exist whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from humanoid_sim.errors import InputError, blaming, reason_of

if TYPE_CHECKING:
    import numpy.typing as npt

LARGEST = 1 << 30  # bytes of a file that is read whole: more than any robot, policy or motion needs
_STAND_INS = {  # first bytes, in lower case, of what often stands in a file's place
    b"version https://git-lfs": "is a pointer of Git LFS, `git lfs pull` fetches the file",
    b"<!doctype html": "is a web page, as a link to a page of the file saves it",
    b"<html": "is a web page, as a link to a page of the file saves it",
    b"sqlite format 3": "is a SQLite database, as rosbag2 may write: `ros2 bag convert` makes .mcap of it",
}


def regular_file(path: str | os.PathLike[str], what: str, largest: int | None = LARGEST) -> Path:
    """Return the path of a file that can be read to its end.

    Raises `InputError` if it is not a regular file, clearly another kind of file, or larger than `largest` bytes; None
    for a reader that needs no more memory for more. `what` it should be, such as `a motion file (.mcap)`.
    """
    path = Path(path)
    with blaming(f"{path}: cannot be read", (OSError, ValueError)):  # ValueError: a null character in the name
        if not path.is_file():  # opening a pipe would wait for a writer that may never come
            raise InputError(f"{path}: {_kind(path)}, expected {what}")
        with path.open("rb") as file:
            size, start = os.fstat(file.fileno()).st_size, file.read(32).lower()
    for beginning, kind in _STAND_INS.items():
        if start.startswith(beginning):
            raise InputError(f"{path}: {kind}; expected {what}")
    if largest is not None and size > largest:
        raise InputError(f"{path}: has {size} bytes, expected {what} of at most {largest}")
    return path


def _kind(path: Path) -> str:
    return "is a directory" if path.is_dir() else "is not a regular file" if path.exists() else "no such file"


def read_arrays(path: str | os.PathLike[str]) -> dict[str, npt.NDArray[Any]]:
    """Return every array of an `.npz` file by its name; none of them may need code to be read.

    Raises `InputError` with the file and what is wrong with it.
    """
    import zipfile  # noqa: PLC0415 - heavy imports stay out of `--help`

    import numpy as np  # noqa: PLC0415

    path = regular_file(path, "an .npz file")
    if not zipfile.is_zipfile(path):  # NumPy would take it for a pickle, and advise to load it
        raise InputError(f"{path}: is not a complete .npz file, which is a ZIP archive of arrays")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except Exception as error:  # NumPy, zipfile and zlib have their own for what is cut or damaged
        raise InputError(f"{path}: is not a complete .npz file of plain arrays: {reason_of(error)}") from None


def output_file(path: str | os.PathLike[str], what: str, *suffixes: str, overwrite: bool = True) -> Path:
    """Return the path of a file to write, checked before the work whose result it will hold.

    `what` is the option that names it, `suffixes` those that its name may have, in lower case; none for any. Raises
    `InputError` if its name has another suffix, is taken without `overwrite`, or cannot be written.
    """
    path = Path(path)
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError(f"{what}: is '{path}', expected a name that ends in {' or '.join(suffixes)}")
    with blaming(f"{what}: '{path}' cannot be written", OSError):
        if path.exists() and not path.is_file():
            raise InputError(f"{what}: '{path}' {_kind(path)}, expected a file name")
        if path.exists() and not overwrite:
            raise InputError(f"{what}: '{path}' exists; choose another name, or add --overwrite")
        if not path.parent.is_dir():
            raise InputError(f"{what}: the folder '{path.parent}' does not exist")
        if not os.access(path.parent, os.W_OK):
            raise InputError(f"{what}: the folder '{path.parent}' cannot be written")
    return path


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Open a new file beside `path`; it gets that name when the block ends, and vanishes if the block raises.

    Raises `InputError` if the file cannot be written; the line names `path` and the reason.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with blaming(f"{path}: cannot be written", OSError):
            with temporary.open("wb") as file:
                yield file
            temporary.replace(path)
    finally:
        with suppress(OSError):  # what kept it from being made keeps it from being removed
            temporary.unlink()


def json_text(value: Any) -> str:
    """Return plain values as indented JSON, null in the place of NaN and infinity, which it does not know."""
    import msgspec  # noqa: PLC0415

    return msgspec.json.format(msgspec.json.encode(value, enc_hook=float), indent=2).decode()
