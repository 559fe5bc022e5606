"""Bounds on what an MJCF may ask for, checked in its text: MuJoCo takes memory before it finds it too much."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

from humanoid_sim import bounds
from humanoid_sim.errors import InputError, blaming, reason_of
from humanoid_sim.files import is_file, regular_file

_ATTRIBUTES = ("file", "filename", "fileup", "filedown", "fileleft", "fileright", "filefront", "fileback")
"""With which an element names a file; `filename` in a URDF."""
_PICTURES = frozenset({"texture", "hfield"})
_FOLDERS = ("meshdir", "texturedir", "assetdir")
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_SIZE = struct.Struct(">8s8xII")
"""A picture's first bytes: what it is, and after a chunk's length and name its width and height."""


def _check(path: Path, *, is_picture: bool) -> int:
    """Its size, bytes."""
    kind, largest = ("a picture", bounds.PICTURE_BYTES) if is_picture else ("a mesh", bounds.MESH_BYTES)
    regular_file(path, kind, largest)
    with blaming(f"{path}: cannot be read", OSError), path.open("rb") as file:
        head = file.read(_PNG_SIZE.size)
    if head.startswith(_PNG) and len(head) == _PNG_SIZE.size:
        _, width, height = _PNG_SIZE.unpack(head)
        if width * height > bounds.MJCF_SIZE:
            raise InputError(
                f"{path}: has {width} by {height} pixels, expected a picture of at most {bounds.MJCF_SIZE}"
            )
    return path.stat().st_size


_SIZES = {
    "hfield": ("nrow", "ncol"),
    "texture": ("width", "height"),
    "numeric": ("size",),
    "user": ("dim",),
    "general": ("actdim",),
    "size": ("nuserdata", "nkey", "njmax", "nconmax", "nstack"),
}
"""By element the attributes whose product is a number of values that MuJoCo makes room for."""
_APART = ("size",)
"""Elements whose attributes are sizes of different things."""
_MODELS = ("include", "model")
"""Elements whose file is another MJCF."""
_COPIES = {"replicate": 1, "composite": 3, "flexcomp": 3}
"""Elements that make others, as often as the product of so many numbers in `count`."""
_SUBDIVISIONS = 7
"""Subdivisions of a built-in sphere: 20·4^7 faces."""
_UNITS = {"K": 10, "M": 20, "G": 30, "T": 40, "P": 50, "E": 60}
_DEPTH = 200
"""Levels of elements: MuJoCo's own parser ends at a few more, and some of its passes recurse."""


def kind_of_model(path: Path) -> str:
    """Return what a file of a robot's model is, by its name: MuJoCo reads both."""
    return "URDF" if path.suffix == ".urdf" else "MJCF model"


def check_mjcf_bounds(path: Path) -> None:
    """Refuse an MJCF that asks for more than any robot needs; whatever else is wrong with it MuJoCo finds.

    Raises `InputError` with the file, the element, its size and what is accepted.
    """
    elements = _Elements(path)
    elements.add(path)
    elements.check_files(path)


class _Elements:
    """The elements of a model, counted over its files; and the meshes and pictures that they name.

    MuJoCo reads those whole, and unpacks pictures, before it finds too much. It looks for a file in the folder of the
    model, in one that a `<compiler>` names, or, if told so, by its bare name; for models that include or attach others
    it depends on the file. So every file that could be meant is looked at.
    """

    def __init__(self, path: Path) -> None:
        self._folder = path.parent
        self._count = 0
        self._seen: set[Path] = set()
        self._names: dict[str, bool] = {}
        """By name whether it is a picture."""
        self._folders: dict[str, None] = {"": None}
        self._bases: dict[Path, None] = {}

    def add(self, path: Path) -> None:
        regular_file(path, "an MJCF", bounds.MJCF_BYTES)
        self._seen.add(path.resolve())
        parents: list[int] = [1]
        try:
            for event, element in ElementTree.iterparse(path, events=("start", "end")):
                if event == "end":
                    parents.pop()
                    element.clear()
                    continue
                if len(parents) > _DEPTH:
                    raise InputError(f"{path}: is nested more than {_DEPTH} levels deep")
                made = parents[-1] * _copies(path, element)
                parents.append(made)
                self._count += made
                if self._count > bounds.MJCF_ELEMENTS:
                    raise InputError(f"{path}: has more than {bounds.MJCF_ELEMENTS} elements at <{element.tag}>")
                for problem in _problems(element):
                    raise InputError(f"{path}: {problem}")
                if element.tag in _MODELS:
                    for included in self._included(path, element):
                        self.add(included)
                else:
                    self._name_files(path, element)
        except ElementTree.ParseError:
            return  # MuJoCo says so, and where
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}: not a valid {kind_of_model(path)}: {reason_of(error)}") from None

    def _included(self, path: Path, element: ElementTree.Element) -> Iterator[Path]:
        for folder in (path.parent, self._folder):
            included = folder / element.get("file", "")
            if is_file(included) and included.resolve() not in self._seen:
                yield included
                return

    def _name_files(self, path: Path, element: ElementTree.Element) -> None:
        self._bases[path.parent] = None
        if element.tag == "compiler":
            self._folders.update(dict.fromkeys(element.get(name, "") for name in _FOLDERS))
            return
        for attribute in _ATTRIBUTES:
            if name := element.get(attribute, ""):
                self._names[name] = element.tag in _PICTURES

    def check_files(self, path: Path) -> None:
        """Refuse files that are larger than any robot's, or no files."""
        if len(self._names) * len(self._folders) * len(self._bases) > bounds.MJCF_ELEMENTS:
            raise InputError(f"{path}: names {len(self._names)} files in {len(self._folders) - 1} folders, too many")
        seen: dict[Path, int] = {}
        for name, is_picture in self._names.items():
            for found in self._found(name):
                if found.resolve() not in seen:
                    seen[found.resolve()] = _check(found, is_picture=is_picture)
        if (total := sum(seen.values())) > bounds.MJCF_FILES_BYTES:
            raise InputError(
                f"{path}: its meshes and pictures have {total} bytes, expected {bounds.MJCF_FILES_BYTES} at most"
            )

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


def _copies(path: Path, element: ElementTree.Element) -> int:
    numbers = _numbers(element, "count")[: _COPIES.get(element.tag, 0)]
    product = math.prod(max(number, 1.0) for number in numbers)
    if not product <= bounds.MJCF_ELEMENTS:
        raise InputError(
            f'{path}: <{element.tag} count="{element.get("count")}"> makes more than {bounds.MJCF_ELEMENTS} elements'
        )
    return int(product)


def _problems(element: ElementTree.Element) -> Iterator[str]:
    names = _SIZES.get(element.tag, ())
    for group in ([name] for name in names) if element.tag in _APART else [names] if names else []:
        given = [(name, _numbers(element, name)) for name in group]
        size = math.prod(max(numbers[0], 1.0) for _, numbers in given if numbers)
        if not size <= bounds.MJCF_SIZE:
            shown = " ".join(f'{name}="{element.get(name)}"' for name, numbers in given if numbers)
            yield f"<{element.tag} {shown}>: expected at most {bounds.MJCF_SIZE} values"
    if element.tag == "size":
        for name, value in element.attrib.items():
            if name == "memory" and _memory(value) > bounds.MJCF_MEMORY:
                yield f'<size memory="{value}">: expected at most {bounds.MJCF_MEMORY} bytes'
            if name.startswith("nuser_") and not max(_numbers(element, name), default=0.0) <= 1000:
                yield f'<size {name}="{value}">: expected at most 1000'
    if element.tag == "mesh" and "builtin" in element.attrib:
        parameters = _numbers(element, "params")
        limit = _SUBDIVISIONS if element.get("builtin") in ("sphere", "hemisphere") else 1000
        if not max(parameters, default=0.0) <= limit:
            yield f'<mesh params="{element.get("params")}">: expected at most {limit}'


def _numbers(element: ElementTree.Element, name: str) -> list[float]:
    """Return the numbers of an attribute, up to the first text that is none; no number counts as too many."""
    numbers = []
    for word in element.get(name, "").split():
        try:
            value = float(word)
        except ValueError:
            break
        numbers.append(math.inf if math.isnan(value) else value)
    return numbers


def _memory(text: str) -> float:
    text = text.strip().upper()
    shift = _UNITS.get(text[-1:], 0)
    try:
        return float(text[:-1] if shift else text) * 2.0**shift
    except ValueError:
        return 0.0
