"""Arrays of an `.npz` file."""

from __future__ import annotations

import os
import zipfile
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError, reason_of
from humanoid_sim.files import regular_file


def read_arrays(path: str | os.PathLike[str]) -> dict[str, npt.NDArray[Any]]:
    """Every array of a file by its name; none of them may need code to be read.

    Raises `InputError` with the file and what is wrong with it.
    """
    path = regular_file(path, "an .npz file")
    try:
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise InputError(f"{path}: holds a single array (.npy), expected an .npz file of several")
            with archive:
                return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path}: is not a complete .npz file of plain arrays: {reason_of(error)}") from None
