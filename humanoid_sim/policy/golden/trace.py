"""A trainer's run in an `.npz` file: what the robot did, what the policy saw, what it answered.

`docs/golden-vectors.md` lists the arrays, one row per policy step, from the activation of the policy on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim import mit
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError
from humanoid_sim.mit import Float32Array, FloatArray, MITState, point_velocity
from humanoid_sim.npz_file import read_arrays
from humanoid_sim.policy.golden.samples import STATE_ARRAYS, recorded_state

BodyReader = Callable[[FloatArray, FloatArray, tuple[str, ...]], Mapping[str, FloatArray]]
"""`(qpos (F, nq), qvel (F, nv), names of its joints) -> arrays` of what a robot's model knows beside its joints."""

_SAME = {"observation": "obs", "action": "actions", mit.VELOCITY_COMMAND: "cmd"}
_LIVE = (mit.VELOCITY_COMMAND, mit.BASE_LINEAR_VELOCITY, mit.ANCHOR_POSE, mit.HEIGHT_SCAN, mit.KEY_PRESSED)


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """A run of F policy steps one after the other from activation on: the robot's side, and what is known beside it."""

    name: str
    joint_names: tuple[str, ...]
    arrays: Mapping[str, FloatArray]
    """`STATE_ARRAYS` of the samples, one row per step."""
    extern: Mapping[str, FloatArray]
    """Live inputs by name, likewise."""
    action: Float32Array
    """Shape (F, m), raw."""
    memory: Mapping[str, npt.NDArray[np.floating | np.integer]] = field(default_factory=lambda: MappingProxyType({}))
    """`last_action`, `frame`, `walked`, `history`, `alignment`, one row per step, as far as the source gives them; what
    it does not follows from the steps before."""
    observation: Float32Array | None = None
    """Shape (F, N), the trainer's."""
    target: FloatArray | None = None
    """Shape (F, J), rad, in the order of `joint_names`; None if the file does not say."""

    def state(self, i: int) -> MITState:
        """Return what the robot reported in step i."""
        return recorded_state(self.arrays, self.extern, i)


def read_trace(path: Path, contract: PolicyContract, bodies: BodyReader | None = None) -> Trace:
    """Read a trace for a policy; joints that the policy does not have are left out.

    Args:
        bodies: of the robot that the trace is of; None: unknown, then a free joint's body is taken for the IMU.
    """
    return _Reader(path, contract, bodies).trace()


class _Reader:
    def __init__(self, path: Path, contract: PolicyContract, bodies: BodyReader | None) -> None:
        self.path = path
        self.contract = contract
        self.bodies = bodies
        self.points = {point_velocity(point): point for point in contract.velocity_points}
        self.live_names = (*_LIVE, *self.points)
        self.arrays = read_arrays(path)
        self.steps = 0

    def trace(self) -> Trace:
        action = self.table("action", self.contract.action_count)
        self.steps = len(action)
        observation = self.table("observation")
        names = self.names()
        # A free joint has 7 values, and any other 1; it has a name of its own, or none.
        surplus = (self.arrays["qpos"].shape[-1] if "qpos" in self.arrays else 0) - len(names)
        hinges = names[1:] if surplus == 6 else names
        known = {**self.live(), **self.states(hinges, free=7 if surplus in (6, 7) else 0)}
        joints = tuple(name for name in hinges if name in self.contract.joint_names)
        missing = [name for name in self.contract.joint_names if name not in joints]
        if missing:
            raise self.wrong("joint_names", f"lacks {', '.join(missing)}", "every joint of the policy")
        columns = [hinges.index(name) for name in joints]
        self.check_needs(known)
        target = self.optional("target", len(hinges))
        known |= {name: known[name][:, columns] for name in ("joint_position", "joint_velocity")}
        known.setdefault("imu_linear_acceleration", np.zeros((self.steps, 3)))
        return Trace(
            name=self.path.name,
            joint_names=joints,
            arrays={name: known[name] for name in STATE_ARRAYS},
            extern={name: known[name] for name in self.live_names if name in known},
            action=self.as_float32("action", action),
            memory=self.memory(),
            observation=self.as_float32("observation", observation),
            target=None if target is None else target[:, columns],
        )

    def names(self) -> tuple[str, ...]:
        names = self.arrays.get("joint_names")
        if names is None or names.ndim != 1 or names.dtype.kind not in "US" or not len(names):
            shown = "is missing" if names is None else f"has shape {names.shape}, type {names.dtype}"
            raise self.wrong("joint_names", shown, "one text per joint, in the order of the state")
        texts = names.astype(str).tolist()
        if len(set(texts)) < len(texts):
            raise self.wrong("joint_names", "names a joint twice", "one text per joint")
        return tuple(texts)

    def states(self, hinges: tuple[str, ...], free: int) -> dict[str, FloatArray]:
        joints = len(hinges)
        if "qpos" not in self.arrays:
            known = {name: self.table(name, joints) for name in ("joint_position", "joint_velocity")}
            known |= {"imu_quaternion": self.table("imu_quaternion", 4)}
            return known | {"imu_angular_velocity": self.table("imu_angular_velocity", 3)}
        qpos, qvel = self.table("qpos", free + joints), self.table("qvel", max(free - 1, 0) + joints)
        found = {"joint_position": qpos[:, free:], "joint_velocity": qvel[:, max(free - 1, 0) :]}
        if self.bodies is not None:
            found |= self.bodies(qpos, qvel, hinges)
        elif free:
            found |= {"imu_quaternion": qpos[:, 3:7], "imu_angular_velocity": qvel[:, 3:6]}
            found |= {mit.BASE_LINEAR_VELOCITY: qvel[:, :3]}
            found |= {name: qvel[:, :3] for name, point in self.points.items() if point == mit.IMU}
        else:
            found |= {"imu_quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (self.steps, 1))}
            found |= {"imu_angular_velocity": np.zeros((self.steps, 3))}
        # What the file says itself comes before what follows from its qpos.
        stated = {name: self.optional(name) for name in (*self.live_names, "imu_quaternion", "imu_angular_velocity")}
        return found | {name: table for name, table in stated.items() if table is not None}

    def live(self) -> dict[str, FloatArray]:
        widths = {
            mit.VELOCITY_COMMAND: 3,
            mit.BASE_LINEAR_VELOCITY: 3,
            mit.ANCHOR_POSE: 7,
            "imu_linear_acceleration": 3,
        }
        widths |= dict.fromkeys(self.points, 3)
        if self.contract.height_scan is not None:
            widths[mit.HEIGHT_SCAN] = self.contract.height_scan.count
        tables = {name: self.optional(name, width) for name, width in widths.items()}
        tables[mit.KEY_PRESSED] = self.optional(mit.KEY_PRESSED)
        return {name: table for name, table in tables.items() if table is not None}

    def check_needs(self, known: Mapping[str, FloatArray]) -> None:
        for term in self.contract.terms:
            array = self.contract.kind(term).input(term)
            if array and array not in known:
                hint = (
                    ", or the robot, whose model tells it from qpos"
                    if array in (mit.ANCHOR_POSE, mit.HEIGHT_SCAN, *self.points)
                    else ""
                )
                raise self.wrong(array, "is missing", f"it, as the policy observes {term.name}{hint}")

    def memory(self) -> dict[str, npt.NDArray[np.floating | np.integer]]:
        found: dict[str, npt.NDArray[np.floating | np.integer]] = {}
        shapes: dict[str, tuple[int, ...]] = {
            "last_action": (self.steps, self.contract.action_count),
            "frame": (self.steps,),
            "walked": (self.steps,),
            "alignment": (self.steps, 7),
        }
        for name in (*shapes, "history"):
            table = self.numbers(name)
            if table is None:
                continue
            if name == "alignment" and table.ndim == 1:
                table = np.broadcast_to(table, (self.steps, len(table)))
            if name == "history":
                if table.ndim != 3 or len(table) != self.steps:
                    raise self.wrong(name, f"has shape {table.shape}", f"({self.steps}, steps, width of one step)")
            elif table.shape != shapes[name]:
                raise self.wrong(name, f"has shape {table.shape}", f"{shapes[name]}")
            found[name] = table
        return found

    def optional(self, name: str, width: int | None = None) -> FloatArray | None:
        return None if self.numbers(name) is None else self.table(name, width)

    def table(self, name: str, width: int | None = None) -> FloatArray:
        """Shape (F, width), float64; one row for all steps is spread out."""
        values = self.numbers(name)
        expected = f"({self.steps or 'F'}, {'width' if width is None else width}), finite numbers"
        if values is None:
            raise self.wrong(name, "is missing", expected)
        if values.ndim == 1 and self.steps and name in self.live_names:
            values = np.broadcast_to(values, (self.steps, len(values)))
        if (
            values.ndim != 2
            or not len(values)
            or len(values) != (self.steps or len(values))
            or (width is not None and values.shape[1] != width)
        ):
            raise self.wrong(name, f"has shape {values.shape}", expected)
        if not np.isfinite(values).all():
            row = int(np.argmax(~np.isfinite(values).all(axis=1)))
            raise self.wrong(name, f"is not finite in row {row}", expected)
        return values.astype(np.float64)

    def as_float32(self, name: str, table: FloatArray) -> Float32Array:
        """Shape (F, width): what a policy saw or answered, in its own precision."""
        if not (np.abs(table) <= np.finfo(np.float32).max).all():
            row = int(np.argmax((np.abs(table) > np.finfo(np.float32).max).any(axis=1)))
            raise self.wrong(name, f"is beyond float32 in row {row}", "finite numbers of 32 bits")
        return table.astype(np.float32)

    def numbers(self, name: str) -> npt.NDArray[Any] | None:
        values = self.arrays.get(name, self.arrays.get(_SAME.get(name, "")))
        if values is not None and values.dtype.kind not in "fiub":
            raise self.wrong(name, f"has type {values.dtype}", "numbers")
        return values

    def wrong(self, name: str, problem: str, expected: str) -> InputError:
        return InputError(f"{self.path}: {name} {problem}, expected {expected}")
