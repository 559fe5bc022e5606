"""The meshes and pictures that an MJCF names: MuJoCo reads them whole, and unpacks pictures, before it finds too much.

MuJoCo looks for a file in the folder of the model, in one that a `<compiler>` names, or, if told so, by its bare name;
for models that include or attach others it depends on the file. So every file that could be meant is looked at.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

from humanoid_sim.bounds import MESH_BYTES, MJCF_ELEMENTS, MJCF_FILES_BYTES, MJCF_SIZE, PICTURE_BYTES
from humanoid_sim.errors import InputError
from humanoid_sim.files import regular_file

_ATTRIBUTES = ("file", "filename", "fileup", "filedown", "fileleft", "fileright", "filefront", "fileback")
"""With which an element names a file; `filename` in a URDF."""
_PICTURES = frozenset({"texture", "hfield"})
_FOLDERS = ("meshdir", "texturedir", "assetdir")
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_SIZE = struct.Struct(">8s8xII")
"""A picture's first bytes: what it is, and after a chunk's length and name its width and height."""


class NamedFiles:
    """What the files of one model name; `check` looks at it once all of them have been read."""

    def __init__(self) -> None:
        self._names: dict[str, bool] = {}
        """By name whether it is a picture."""
        self._folders: dict[str, None] = {"": None}
        self._bases: dict[Path, None] = {}

    def add(self, path: Path, element: ElementTree.Element) -> None:
        """Take what an element of the file `path` names."""
        self._bases[path.parent] = None
        if element.tag == "compiler":
            self._folders.update(dict.fromkeys(element.get(name, "") for name in _FOLDERS))
            return
        for attribute in _ATTRIBUTES:
            if name := element.get(attribute, ""):
                self._names[name] = element.tag in _PICTURES

    def check(self, path: Path) -> None:
        """Refuse files that are larger than any robot's, or no files.

        Args:
            path: of the model.

        Raises:
            InputError: one line with the file, its size and what is accepted.
        """
        if len(self._names) * len(self._folders) * len(self._bases) > MJCF_ELEMENTS:
            raise InputError(f"{path}: names {len(self._names)} files in {len(self._folders) - 1} folders, too many")
        seen: dict[Path, int] = {}
        for name, is_picture in self._names.items():
            for found in self._found(name):
                if found.resolve() not in seen:
                    seen[found.resolve()] = _check(found, is_picture=is_picture)
        if (total := sum(seen.values())) > MJCF_FILES_BYTES:
            raise InputError(f"{path}: its meshes and pictures have {total} bytes, expected {MJCF_FILES_BYTES} at most")

    def _found(self, name: str) -> Iterator[Path]:
        bare = PurePosixPath(name.replace("\\", "/")).name
        for base in self._bases:
            for folder in self._folders:
                for candidate in dict.fromkeys((name, bare)):
                    place = base / folder / candidate
                    try:
                        is_there = place.exists() and not place.is_dir()
                    except (OSError, ValueError):  # no name that a file can have: MuJoCo says so
                        continue
                    if is_there:
                        yield place


def _check(path: Path, *, is_picture: bool) -> int:
    """Its size, bytes."""
    kind, largest = ("a picture", PICTURE_BYTES) if is_picture else ("a mesh", MESH_BYTES)
    regular_file(path, kind, largest)
    try:
        with path.open("rb") as file:
            head = file.read(_PNG_SIZE.size)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if head.startswith(_PNG) and len(head) == _PNG_SIZE.size:
        _, width, height = _PNG_SIZE.unpack(head)
        if width * height > MJCF_SIZE:
            raise InputError(f"{path}: has {width} by {height} pixels, expected a picture of at most {MJCF_SIZE}")
    return path.stat().st_size
