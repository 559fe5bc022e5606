"""Tensors that a model keeps in files beside it, and whether those are this model's."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file

if TYPE_CHECKING:
    from onnx import ModelProto

TENSORS_KEY = "humanoid_sim_tensors"
"""Metadata key of the digest of a stamped model's tensors, wherever they lie."""
_LOCATION = "location"
"""Key of ONNX for the file that holds a tensor."""


def external_file(path: Path) -> Path:
    """Return where exporters put a model's external tensors; there need be no such file."""
    return path.with_name(f"{path.name}.data")


def tensor_digest(model: ModelProto) -> str:
    """SHA-256 of a model's tensors: their names, types, shapes and values.

    Args:
        model: with its external tensors loaded.
    """
    from onnx import numpy_helper  # noqa: PLC0415 - heavy, and rarely needed

    digest = hashlib.sha256()
    for tensor in sorted(model.graph.initializer, key=lambda tensor: str(tensor.name)):
        values = np.ascontiguousarray(numpy_helper.to_array(tensor))
        digest.update(f"{tensor.name} {values.dtype} {values.shape}\n".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()


def check_tensors(path: Path, metadata: Mapping[str, str]) -> None:
    """Refuse a stamped model, one that can be loaded, whose external tensors are another one's.

    One that was not stamped can only be told by its golden vectors.
    """
    raw = path.read_bytes()
    if _LOCATION.encode() not in raw or TENSORS_KEY not in metadata:
        return
    import onnx  # noqa: PLC0415 - heavy, and rarely needed

    entries = _entries(onnx.load_model_from_string(raw))
    if entries and tensor_digest(onnx.load(str(path))) != metadata[TENSORS_KEY]:
        files = ", ".join(str(path.parent / name) for name in dict.fromkeys(entry[_LOCATION] for entry in entries))
        raise InputError(f"{files}: holds other tensors than {path.name} was stamped with: is it another model's?")


def why_not_loaded(path: Path) -> str:
    """Return why the file that holds the tensors of a model keeps it from being loaded; '' if it does not."""
    import onnx  # noqa: PLC0415 - heavy, and only needed to say what is wrong
    from google.protobuf.message import DecodeError  # noqa: PLC0415 - comes with onnx

    needed: dict[str, int] = {}
    try:
        for entry in _entries(onnx.load_model_from_string(path.read_bytes())):
            end = int(entry.get("offset", 0)) + int(entry.get("length", 0))
            needed[entry[_LOCATION]] = max(end, needed.get(entry[_LOCATION], 0))
    except (DecodeError, ValueError):  # no model at all, or a place that is not a number
        return ""
    for name, size in needed.items():
        file = path.parent / name
        if not is_file(file):
            return f"{path}: keeps its tensors in '{name}', which is not beside it; copy that file as well"
        if file.stat().st_size < size:
            return (
                f"{file}: has {file.stat().st_size} bytes, expected at least {size}, the tensors of {path.name}: is it "
                "another model's, or cut off?"
            )
    return ""


def _entries(model: ModelProto) -> list[dict[str, str]]:
    """Return what the model says of each tensor that lies in another file."""
    entries = [{item.key: item.value for item in tensor.external_data} for tensor in model.graph.initializer]
    return [entry for entry in entries if _LOCATION in entry]
