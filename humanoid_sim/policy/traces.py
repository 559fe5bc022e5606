"""A trainer's run: what the robot did, what the policy saw, what it answered.

`docs/golden-vectors.md` lists the arrays of the `.npz` file, one row per policy step, from activation on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim import mit
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import PolicyMemory
from humanoid_sim.controllers.reference import Alignment
from humanoid_sim.errors import InputError
from humanoid_sim.files import read_arrays
from humanoid_sim.mit import Extern, FloatArray, MITState, point_velocity

Arrays = Mapping[str, npt.NDArray[Any]]
BodyReader = Callable[[FloatArray, FloatArray, tuple[str, ...]], Mapping[str, FloatArray]]
"""`(qpos (F, nq), qvel (F, nv), names of its joints) -> arrays` of what a robot's model knows beside its joints."""

STATE_ARRAYS = (
    *("joint_position", "joint_velocity"),
    *("imu_quaternion", "imu_angular_velocity", "imu_linear_acceleration"),
)
"""What the robot reports, apart from the live inputs."""
EXTERN, REFERENCE = "extern/", "reference/"
"""Prefixes of the names of live inputs, and of the motion's terms."""
MUJOCO_VERSION = "mujoco_version"
"""Text in the file of a trace: the version that simulated it."""
_NAMES = {"obs": "observation", "actions": "action", "cmd": mit.VELOCITY_COMMAND}
_MEMORY: Mapping[str, type[np.generic]] = {
    "last_action": np.float32,
    "frame": np.int64,
    "walked": np.float64,
    "history": np.float32,
    "alignment": np.float64,
}


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """S policy steps of a run."""

    name: str
    """Name of the file that it comes from."""
    joint_names: tuple[str, ...]
    """The J joints of the states, in the robot's order."""
    arrays: Arrays
    """By name, S rows each: `STATE_ARRAYS` (rad, rad/s, w x y z, m/s²); `extern/NAME` of each live input; `observation`
    and `action`, raw; `target`, rad, where the trainer's is known. Of the policy's memory, as far as it is known:
    `last_action`, `frame`, `walked` (rad of gait phase), `history` (S, steps, width) oldest first, `alignment` (S, 7),
    the motion's world in the robot's; NaN where there is none. `reference/NAME`: rows of the motion at `frame`, for a
    model that does not carry it."""
    frame_count: int = 1
    """Frames of that motion."""
    mujoco_version: str = ""
    """Of the simulation; empty if the file does not say."""

    def __len__(self) -> int:
        return len(self.arrays["action"])

    def under(self, prefix: str) -> Arrays:
        """Return the arrays of live inputs, or of the motion, by their own names."""
        return {name.removeprefix(prefix): array for name, array in self.arrays.items() if name.startswith(prefix)}

    def rows(self, chosen: npt.NDArray[np.intp]) -> Trace:
        """Return these steps alone."""
        return replace(self, arrays={name: array[chosen] for name, array in self.arrays.items()})

    def state(self, i: int) -> MITState:
        """Return what the robot reported in step i; efforts are not recorded."""
        zeros = np.zeros(len(self.joint_names))
        return MITState(
            time=0.0,
            **{name: self.arrays[name][i] for name in STATE_ARRAYS},
            joint_effort=zeros,
            joint_age=zeros,
            extern={name: Extern(array[i], 0.0) for name, array in self.under(EXTERN).items()},
        )

    def memory(self, i: int, memory: PolicyMemory) -> PolicyMemory:
        """Return a policy's memory with what is known of it in step i."""
        known: dict[str, Any] = {name: self.arrays[name][i] for name in _MEMORY if name in self.arrays}
        for name in {"history", "alignment"} & known.keys():
            if np.isnan(known[name]).any():
                known[name] = None
        if known.get("alignment") is not None:
            known["alignment"] = Alignment(yaw=known["alignment"][3:], offset=known["alignment"][:3])
        return replace(memory, **known)


def read_trace(path: Path, contract: PolicyContract, bodies: BodyReader | None = None) -> Trace:
    """Read a trace for a policy; joints that the policy does not have are left out.

    Raises `InputError` with the array that is wrong.

    Args:
        bodies: of the robot that the trace is of; None: unknown, then a free joint's body is taken for the IMU.
    """
    file = _File(path, {_NAMES.get(name, name): array for name, array in read_arrays(path).items()})
    action = file.table("action", contract.action_count)
    file.steps = len(action)
    names = file.joint_names()
    # A free joint has 7 values, and any other 1; it has a name of its own, or none.
    surplus = file.arrays["qpos"].shape[-1] - len(names) if "qpos" in file.arrays else 0
    hinges = names[1:] if surplus == 6 else names
    missing = [name for name in contract.joint_names if name not in hinges]
    if missing:
        raise file.wrong("joint_names", f"lacks {', '.join(missing)}", "every joint of the policy")
    points = {point_velocity(point): point for point in contract.velocity_points}
    known = _states(file, hinges, 7 if surplus in (6, 7) else 0, points, bodies)
    widths = {mit.VELOCITY_COMMAND: 3, mit.BASE_LINEAR_VELOCITY: 3, mit.ANCHOR_POSE: 7, **dict.fromkeys(points, 3)}
    if contract.height_scan is not None:
        widths[mit.HEIGHT_SCAN] = contract.height_scan.count
    live = (*widths, mit.KEY_PRESSED)
    # What the file says itself comes before what follows from its qpos.
    known |= {name: file.table(name, widths.get(name)) for name in (*live, *STATE_ARRAYS[2:]) if name in file.arrays}
    for term in contract.terms:
        array = contract.kind(term).input(term)
        if array and array not in known:
            hint = ", or the robot, whose model tells it from qpos" if array != mit.VELOCITY_COMMAND else ""
            raise file.wrong(array, "is missing", f"it, as the policy observes {term.name}{hint}")
    joints = tuple(name for name in hinges if name in contract.joint_names)
    columns = [hinges.index(name) for name in joints]
    known.setdefault("imu_linear_acceleration", np.zeros((file.steps, 3)))
    arrays: dict[str, npt.NDArray[Any]] = {name: known[name] for name in STATE_ARRAYS}
    arrays |= {name: known[name][:, columns] for name in STATE_ARRAYS[:2]}
    arrays |= {EXTERN + name: known[name] for name in live if name in known}
    arrays |= {"observation": file.table("observation").astype(np.float32), "action": action.astype(np.float32)}
    if "target" in file.arrays:
        arrays["target"] = file.table("target", len(hinges))[:, columns]
    arrays |= {name: file.memory(name, kind) for name, kind in _MEMORY.items() if name in file.arrays}
    return Trace(path.name, joints, arrays, mujoco_version=str(file.arrays.get(MUJOCO_VERSION, "")))


@dataclass
class _File:
    """The arrays of a file."""

    path: Path
    arrays: Arrays
    steps: int = 0
    """Steps of the run, once they are known."""

    def table(self, name: str, width: int | None = None) -> FloatArray:
        """Return an array as shape (F, width), float64; one row for all steps is spread out."""
        expected = f"({self.steps or 'F'}, {'width' if width is None else width}), finite numbers"
        values = self.arrays.get(name)
        if values is None or values.dtype.kind not in "fiub":
            raise self.wrong(name, "is missing" if values is None else f"has type {values.dtype}", expected)
        if values.ndim == 1 and self.steps and name != "observation":
            values = np.broadcast_to(values, (self.steps, len(values)))
        steps = self.steps or len(values)
        if values.ndim != 2 or not steps or values.shape != (steps, width or values.shape[1]):
            raise self.wrong(name, f"has shape {values.shape}", expected)
        if not np.isfinite(values).all():
            row = int(np.argmax(~np.isfinite(values).all(axis=1)))
            raise self.wrong(name, f"is not finite in row {row}", expected)
        return values.astype(np.float64)

    def memory(self, name: str, kind: type[np.generic]) -> npt.NDArray[Any]:
        """Return what a run says of the policy's memory: F rows, or one alignment for all."""
        values = self.arrays[name]
        if name == "alignment" and values.ndim == 1:
            values = np.broadcast_to(values, (self.steps, len(values)))
        if values.ndim == 0 or len(values) != self.steps:
            raise self.wrong(name, f"has shape {values.shape}", f"{self.steps} rows")
        return values.astype(kind)

    def joint_names(self) -> tuple[str, ...]:
        names = self.arrays.get("joint_names")
        if names is None or names.ndim != 1 or names.dtype.kind not in "US" or not len(names):
            shown = "is missing" if names is None else f"has shape {names.shape}, type {names.dtype}"
            raise self.wrong("joint_names", shown, "one text per joint, in the order of the state")
        texts = tuple(names.astype(str).tolist())
        if len(set(texts)) < len(texts):
            raise self.wrong("joint_names", "names a joint twice", "one text per joint")
        return texts

    def wrong(self, name: str, problem: str, expected: str) -> InputError:
        return InputError(f"{self.path}: {name} {problem}, expected {expected}")


def _states(
    file: _File, hinges: tuple[str, ...], free: int, points: Mapping[str, str], bodies: BodyReader | None
) -> dict[str, FloatArray]:
    """Return what a run says of the robot: as arrays, or as far as it follows from `qpos` and `qvel`."""
    joints = len(hinges)
    if "qpos" not in file.arrays:
        widths = zip(STATE_ARRAYS, (joints, joints, 4, 3), strict=False)
        return {name: file.table(name, width) for name, width in widths}
    qpos, qvel = file.table("qpos", free + joints), file.table("qvel", max(free - 1, 0) + joints)
    found = {"joint_position": qpos[:, free:], "joint_velocity": qvel[:, max(free - 1, 0) :]}
    if bodies is not None:
        return found | dict(bodies(qpos, qvel, hinges))
    if not free:
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (file.steps, 1))
        return found | {"imu_quaternion": upright, "imu_angular_velocity": np.zeros((file.steps, 3))}
    found |= {"imu_quaternion": qpos[:, 3:7], "imu_angular_velocity": qvel[:, 3:6]}
    return found | {mit.BASE_LINEAR_VELOCITY: qvel[:, :3]} | {n: qvel[:, :3] for n, p in points.items() if p == mit.IMU}
