"""Files of a user: paths checked before anything opens them, and outputs that exist whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from humanoid_sim.errors import InputError, blaming

if TYPE_CHECKING:
    import numpy.typing as npt

LARGEST = 1 << 30  # bytes of a file that is read whole: more than any robot, policy or motion needs
_SHOWN = 40  # characters of a file's name that its temporary one begins with: 255 bytes are the most
_COUNT = count()


def regular_file(path: str | os.PathLike[str], what: str, largest: int | None = LARGEST) -> Path:
    """Return the path of a file that can be read to its end.

    Raises `InputError` if there is no such file, it is a directory, a pipe or a device, or it is larger than `largest`
    bytes; None for a reader that needs no more memory for more. `what` it should be, such as `a motion file (.mcap)`.
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
    if not path.is_file():  # opening a pipe would wait for a writer that may never come
        raise InputError(f"{path}: is {_kind(path)}, expected {what}")
    if largest is not None and size > largest:
        raise InputError(f"{path}: has {size} bytes, expected {what} of at most {largest}")
    return path


def _kind(path: Path) -> str:
    return "a directory" if path.is_dir() else "a pipe or a device"


def read_arrays(path: str | os.PathLike[str]) -> dict[str, npt.NDArray[Any]]:
    """Return every array of an `.npz` file by its name; none of them may need code to be read.

    Raises `InputError` with the file and what is wrong with it.
    """
    import zipfile  # noqa: PLC0415 - heavy imports stay out of `--help`
    import zlib  # noqa: PLC0415

    import numpy as np  # noqa: PLC0415

    path = regular_file(path, "an .npz file")
    broken = (OSError, ValueError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error)
    with blaming(f"{path}: is not a complete .npz file of plain arrays", broken), path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        if isinstance(archive, np.ndarray):
            raise ValueError("it holds a single array (.npy)")
        return {name: archive[name] for name in archive.files}


def output_file(path: str | os.PathLike[str], what: str, *suffixes: str, overwrite: bool = True) -> Path:
    """Return the path of a file to write, checked before the work whose result it will hold.

    `what` is the option that names it, `suffixes` those that its name may have, in lower case; none for any. Raises
    `InputError` if its name has another suffix, is taken without `overwrite`, or cannot be written.
    """
    path = Path(path)
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError(f"{what}: is '{path}', expected a name that ends in {' or '.join(suffixes)}")
    with blaming(f"{what}: '{path}' cannot be written", OSError):
        exists = path.exists()
        if exists and not path.is_file():
            raise InputError(f"{what}: '{path}' is {_kind(path)}, expected a file name")
        if exists and not overwrite:
            raise InputError(f"{what}: '{path}' exists; choose another name, or add --overwrite")
        if not path.parent.is_dir():
            raise InputError(f"{what}: the folder '{path.parent}' does not exist")
        tempfile.TemporaryFile(dir=path.absolute().parent).close()
    return path


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Open a new file beside `path`; it gets that name when the block ends, and vanishes if the block raises.

    Raises `InputError` if the file cannot be written; the line names `path` and the reason.
    """
    path = Path(path)
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
        with suppress(OSError):  # what kept it from being made keeps it from being removed
            temporary.unlink()


def finite(value: Any) -> Any:
    """Return plain values with null in the place of NaN and infinity, which JSON does not know."""
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, Mapping):
        return {name: finite(item) for name, item in value.items()}
    return [finite(item) for item in value] if isinstance(value, list | tuple) else value
