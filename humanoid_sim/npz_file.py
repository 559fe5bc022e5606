"""Arrays of an `.npz` file, whose headers are believed only as far as the file has bytes for them."""

from __future__ import annotations

import os
import tokenize
import zipfile
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.bounds import NPZ_ARRAYS, NPZ_BYTES
from humanoid_sim.errors import InputError, reason_of
from humanoid_sim.files import regular_file

_DAMAGE = (
    ValueError,
    EOFError,
    KeyError,
    TypeError,
    SyntaxError,
    NotImplementedError,
    RuntimeError,
    MemoryError,
    OverflowError,
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    tokenize.TokenError,
)
"""Errors that NumPy and zipfile raise for files that are damaged, or of another kind: NumPy reads headers with Python's
own parser, and allocates the memory that a header asks for before it looks for its bytes."""
_LAST_CHARACTER = 0x10FFFF
"""Last character of Unicode; Python fails on a text with one beyond it."""
_VERSIONS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def read_arrays(path: str | os.PathLike[str]) -> dict[str, npt.NDArray[Any]]:
    """Every array of a file by its name; none of them may need code to be read.

    Raises `InputError` with the file and what is wrong with it.
    """
    path = regular_file(path, "an .npz file")
    try:
        with path.open("rb") as stream:
            if stream.read(6) == b"\x93NUMPY":
                raise InputError(f"{path}: holds a single array (.npy), expected an .npz file of several")
            with zipfile.ZipFile(stream) as archive:
                members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
                _check_sizes(path, members)
                return {member.filename.removesuffix(".npy"): _array(path, archive, member) for member in members}
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or reason_of(error)}") from None
    except _DAMAGE as error:
        # A ValueError also stands for pickled objects, which may run code.
        raise InputError(f"{path}: is not a complete .npz file of plain arrays: {reason_of(error)}") from None


def _check_sizes(path: os.PathLike[str], members: list[zipfile.ZipInfo]) -> None:
    if len(members) > NPZ_ARRAYS:
        raise InputError(f"{path}: holds {len(members)} arrays, expected at most {NPZ_ARRAYS}")
    size = sum(member.file_size for member in members)
    if size > NPZ_BYTES:
        raise InputError(f"{path}: its arrays have {size} bytes, expected at most {NPZ_BYTES}")


def _array(path: os.PathLike[str], archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> npt.NDArray[Any]:
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        if version not in _VERSIONS:
            raise ValueError(f"version {version} of an array's header")
        shape, _, dtype = _VERSIONS[version](stream)
    if dtype.hasobject:
        raise ValueError(f"{member.filename}: Object arrays cannot be loaded, they may run code")
    claimed = dtype.itemsize
    for size in shape:
        claimed *= size
    if claimed > member.file_size or min(shape, default=0) < 0:
        name = member.filename.removesuffix(".npy")
        raise InputError(f"{path}: {name} claims shape {shape} of {dtype}, and has {member.file_size} bytes")
    with archive.open(member) as stream:
        array: npt.NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    if array.dtype.kind == "U" and array.size:
        native = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("="))
        if native.reshape(-1).view(np.uint32).max(initial=0) > _LAST_CHARACTER:
            raise ValueError(f"{member.filename} holds texts that are none")
    return array
