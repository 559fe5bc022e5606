"""Samples of a run, and their form inside a checkpoint's metadata: JSON with arrays in base64."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import prod
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError, InputError, blaming
from humanoid_sim.mit import Extern, Float32Array, FloatArray, IntArray, MITState

GOLDEN_KEY = "humanoid_sim_golden"
"""Metadata key of the samples."""

Origin = Literal["trainer", "own"]

_VERSION = 1
_LARGEST = 10_000_000
"""Values of one array: far above any policy, and small enough not to fill the memory."""
_EXTERN, _REFERENCE = "extern/", "reference/"


_ARRAYS: Mapping[str, tuple[str, tuple[int | str, ...] | None]] = {
    "joint_position": ("<f8", ("J",)),
    "joint_velocity": ("<f8", ("J",)),
    "imu_quaternion": ("<f8", (4,)),
    "imu_angular_velocity": ("<f8", (3,)),
    "imu_linear_acceleration": ("<f8", (3,)),
    "last_action": ("<f4", ("m",)),
    "frame": ("<i8", ()),
    "walked": ("<f8", ()),
    "alignment": ("<f8", (7,)),
    "observation": ("<f4", None),
    "action": ("<f4", ("m",)),
    "target": ("<f8", ("J",)),
    "history": ("<f4", None),
}
"""Type and shape of each array of one sample; None: another check."""
STATE_ARRAYS = tuple(_ARRAYS)[:5]
"""Arrays that the robot reports, apart from the live inputs."""


@dataclass(frozen=True, slots=True, eq=False)
class GoldenSamples:
    """S instants of a run: what the robot reported, what the policy remembered, what it saw and answered."""

    origin: Origin
    """`trainer`: the observations are those of the trainer's run; `own`: this program's."""
    source: str
    """Name of the file that the samples came from; empty for own ones."""
    joint_names: tuple[str, ...]
    """The J joints of the states, in the robot's order."""
    joint_position: FloatArray
    """Shape (S, J), rad."""
    joint_velocity: FloatArray
    """Shape (S, J), rad/s."""
    imu_quaternion: FloatArray
    """Shape (S, 4), w x y z."""
    imu_angular_velocity: FloatArray
    """Shape (S, 3), rad/s, body frame."""
    imu_linear_acceleration: FloatArray
    """Shape (S, 3), m/s², body frame, gravity included."""
    last_action: Float32Array
    """Shape (S, m), raw."""
    frame: IntArray
    """Shape (S,), reference frame."""
    walked: FloatArray
    """Shape (S,), rad of gait phase since activation, or since standing, before the sample's own step."""
    alignment: FloatArray
    """Shape (S, 7), x y z in m and w x y z: the motion's world in the robot's; NaN where none was laid out."""
    observation: Float32Array
    """Shape (S, N), as the policy saw it."""
    action: Float32Array
    """Shape (S, m), raw, as the policy answered."""
    target: FloatArray
    """Shape (S, J), rad, commanded joint positions."""
    target_origin: Origin = "own"
    """Likewise of the targets, which traces need not hold."""
    extern: Mapping[str, FloatArray] = field(default_factory=lambda: MappingProxyType({}))
    """Live inputs by name, each of shape (S, width)."""
    history: Float32Array | None = None
    """Shape (S, h, w): the steps before each sample's own as the policy saw them, oldest first; None without."""
    reference: Mapping[str, Float32Array] = field(default_factory=lambda: MappingProxyType({}))
    """Rows of the motion at `frame`, by term; empty where the model carries its motion, or follows none."""
    frame_count: int = 1
    """Frames of that motion."""

    def __post_init__(self) -> None:
        if self.origin not in get_args(Origin) or self.target_origin not in get_args(Origin):
            raise FieldError(f"origin is {self.origin!r}, {self.target_origin!r}, expected trainer or own")
        if not self.joint_names or not all(isinstance(name, str) for name in self.joint_names):
            raise FieldError("joint_names: expected names")
        count, joints = len(self.frame), len(self.joint_names)
        if not count or self.frame_count < 1 or self.action.ndim != 2:
            raise FieldError(f"holds {count} samples of {self.frame_count} frames, expected at least one of each")
        sizes = {"J": joints, "m": self.action.shape[1]}
        for name, (_, shape) in _ARRAYS.items():
            if shape is not None:
                expected = (count, *(sizes[size] if isinstance(size, str) else size for size in shape))
                if getattr(self, name).shape != expected:
                    raise FieldError(f"{name}: has shape {getattr(self, name).shape}, expected {expected}")
        tables: dict[str, npt.NDArray[Any]] = {"observation": self.observation, **self.extern, **self.reference}
        for name, table in tables.items():
            if table.ndim != 2 or len(table) != count:
                raise FieldError(f"{name}: has shape {table.shape}, expected ({count}, width)")
        if self.history is not None and (self.history.ndim != 3 or len(self.history) != count):
            raise FieldError(f"history: has shape {self.history.shape}, expected ({count}, steps, width)")
        if self.reference and not ((self.frame >= 0) & (self.frame < self.frame_count)).all():
            raise FieldError(f"frame: goes beyond the {self.frame_count} frames of the motion")

    def state(self, i: int) -> MITState:
        """Return what the robot reported in sample i."""
        return recorded_state({name: getattr(self, name) for name in STATE_ARRAYS}, self.extern, i)

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def label(self) -> str:
        """Return what the samples are worth, in words."""
        if self.origin == "own":
            return f"{len(self)} samples, drift only: made by this program, they show change, not wrong wiring"
        targets = (
            ""
            if self.target_origin == "trainer"
            else "; the trace holds no joint targets, so scale and offset are not proved"
        )
        return f"{len(self)} samples of the trainer's run ({self.source}){targets}"


def recorded_state(arrays: Mapping[str, FloatArray], extern: Mapping[str, FloatArray], i: int) -> MITState:
    """Return what the robot reported in row i of a run: `STATE_ARRAYS`, and live inputs; efforts are not recorded."""
    zeros = np.zeros(arrays["joint_position"].shape[1])
    return MITState(
        time=0.0,
        **{name: arrays[name][i] for name in STATE_ARRAYS},
        joint_effort=zeros,
        joint_age=zeros,
        extern={name: Extern(table[i], 0.0) for name, table in extern.items()},
    )


def encode_samples(samples: GoldenSamples) -> str:
    """One line of JSON from which `decode_samples` makes the same samples, bit for bit."""
    arrays = {name: getattr(samples, name) for name in _ARRAYS if getattr(samples, name) is not None}
    arrays |= {_EXTERN + name: array for name, array in samples.extern.items()}
    arrays |= {_REFERENCE + name: array for name, array in samples.reference.items()}
    little = {name: np.ascontiguousarray(array, array.dtype.newbyteorder("<")) for name, array in arrays.items()}
    document = {
        "version": _VERSION,
        "origin": samples.origin,
        "source": samples.source,
        "target_origin": samples.target_origin,
        "joint_names": list(samples.joint_names),
        "frame_count": samples.frame_count,
        "arrays": {
            name: {"shape": list(array.shape), "data": base64.b64encode(array.tobytes()).decode()}
            for name, array in little.items()
        },
    }
    return json.dumps(document)


def decode_samples(text: str, where: str) -> GoldenSamples:
    """Return the samples in a text of `encode_samples`."""
    try:
        document = json.loads(text)
        if document["version"] != _VERSION:
            raise FieldError(f"have version {document['version']!r}, expected {_VERSION}")
        arrays = {str(name): _decode(name, value) for name, value in document["arrays"].items()}
        frame_count = document["frame_count"]
        if type(frame_count) is not int or frame_count > _LARGEST:
            raise FieldError(f"frame_count is {frame_count!r}, expected a whole number")
        plain = {name: array for name, array in arrays.items() if "/" not in name}
        return GoldenSamples(
            origin=document["origin"],
            source=str(document["source"]),
            target_origin=document["target_origin"],
            joint_names=tuple(document["joint_names"]),
            frame_count=frame_count,
            extern=_under(_EXTERN, arrays),
            reference=_under(_REFERENCE, arrays),
            **plain,
        )
    except FieldError as error:
        raise InputError(f"{where}: golden vectors: {error}") from None
    except KeyError as error:
        raise InputError(f"{where}: golden vectors lack {error}; stamp the checkpoint again") from None
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        problem = str(error).partition("\n")[0]
        raise InputError(f"{where}: golden vectors are malformed: {problem}; stamp the checkpoint again") from None


def _decode(name: str, value: Any) -> npt.NDArray[Any]:
    prefix = name[: name.find("/") + 1]
    kind = {_EXTERN: "<f8", _REFERENCE: "<f4"}.get(prefix) or _ARRAYS.get(name, ("",))[0]
    if not kind:
        raise FieldError(f"hold the unknown array '{name}'")
    shape, dtype = tuple(value["shape"]), np.dtype(kind)
    if not all(type(size) is int and size >= 0 for size in shape) or prod(shape) > _LARGEST:
        raise FieldError(f"{name}: has shape {shape}, expected sizes >= 0")
    with blaming(f"{name}: is not base64", binascii.Error, FieldError):
        data = base64.b64decode(value["data"], validate=True)
    if len(data) != prod(shape) * dtype.itemsize:
        raise FieldError(f"{name}: has {len(data)} bytes, expected {prod(shape) * dtype.itemsize} for shape {shape}")
    array = np.frombuffer(data, dtype=dtype).reshape(shape)  # read-only, as the bytes are
    return array.astype(dtype.newbyteorder("="), copy=False)


def _under(prefix: str, arrays: Mapping[str, npt.NDArray[Any]]) -> Mapping[str, npt.NDArray[Any]]:
    found = {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
    return MappingProxyType(found)
