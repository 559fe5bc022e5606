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
from humanoid_sim.errors import FieldError, blaming
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
EXTERN, REFERENCE = "extern/", "reference/"  # prefixes of the names of live inputs, and of the motion's terms
_NAMES = {"obs": "observation", "actions": "action", "cmd": mit.VELOCITY_COMMAND}
_MEMORY = ("last_action", "frame", "walked", "history", "alignment")
_FLOAT32 = ("last_action", "observation", "action", "history")


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """S policy steps of a run."""

    name: str  # of the file
    joint_names: tuple[str, ...]  # the J joints of the states, in the robot's order
    arrays: Arrays
    """By name, S rows each: `STATE_ARRAYS` (rad, rad/s, w x y z, m/s²); `extern/NAME` of each live input; `observation`
    and `action`, raw; `target`, rad, where the trainer's is known. Of the policy's memory, as far as it is known:
    `last_action`, `frame`, `walked` (rad of gait phase), `history` (S, steps, width) oldest first, `alignment` (S, 7),
    the motion's world in the robot's; NaN where there is none. `reference/NAME`: rows of the motion at `frame`, for a
    model that does not carry it."""
    frame_count: int = 1  # of that motion

    def __len__(self) -> int:
        return len(self.arrays["action"])

    def under(self, prefix: str) -> Arrays:
        """Return the arrays of live inputs, or of the motion, by their own names."""
        return {name.removeprefix(prefix): array for name, array in self.arrays.items() if name.startswith(prefix)}

    def state(self, i: int) -> MITState:
        """Return what the robot reported in step i; efforts are not recorded."""
        zeros = np.zeros(len(self.joint_names))
        extern = {name: Extern(array[i], 0.0) for name, array in self.under(EXTERN).items()}
        rows = {name: self.arrays[name][i] for name in STATE_ARRAYS}
        return MITState(time=0.0, **rows, joint_effort=zeros, joint_age=zeros, extern=extern)

    def memory(self, i: int, memory: PolicyMemory) -> PolicyMemory:
        """Return a policy's memory with what is known of it in step i."""
        known: dict[str, Any] = {name: self.arrays[name][i] for name in _MEMORY if name in self.arrays}
        known |= {name: None for name in ("history", "alignment") if np.isnan(known.get(name, 0.0)).any()}
        if known.get("alignment") is not None:
            known["alignment"] = Alignment(yaw=known["alignment"][3:], offset=known["alignment"][:3])
        return replace(memory, **known)


def array_type(name: str) -> str:
    """Return the type of an array of a `Trace`, as NumPy names it."""
    if name == "frame":
        return "<i8"
    return "<f4" if name in _FLOAT32 or name.startswith(REFERENCE) else "<f8"


def read_trace(path: Path, contract: PolicyContract, bodies: BodyReader | None = None) -> Trace:
    """Read a trace for a policy; joints that the policy does not have are left out.

    Raises `InputError` with the array that is wrong. `bodies` is of the robot that the trace is of, for `qpos`.
    """
    given = {_NAMES.get(name, name): array for name, array in read_arrays(path).items()}
    with blaming(path, (FieldError, ValueError)):
        return _trace(path.name, given, contract, bodies)


def _trace(name: str, given: Arrays, contract: PolicyContract, bodies: BodyReader | None) -> Trace:
    if "action" not in given or "joint_names" not in given or not given["action"].size:
        raise FieldError(f"has {', '.join(given)}, expected joint_names, and action with a row for each step")
    steps, names = len(given["action"]), tuple(given["joint_names"].astype(str).tolist())
    # A free joint has 7 values, and any other 1; it has a name of its own, or none.
    surplus = given["qpos"].shape[-1] - len(names) if "qpos" in given else 0
    hinges, free = names[1:] if surplus == 6 else names, 7 if surplus in (6, 7) else 0
    count = len(hinges)
    missing = [joint for joint in contract.joint_names if joint not in hinges]
    if missing:
        raise FieldError(f"joint_names lacks {', '.join(missing)}, expected every joint of the policy")
    if "qpos" in given:
        if bodies is None:
            raise FieldError("qpos needs the trainer's robot, whose model says where its IMU is: --robot")
        qpos = _table(given, "qpos", steps, free + count)
        qvel = _table(given, "qvel", steps, max(free - 1, 0) + count)
        joints = {"joint_position": qpos[:, free:], "joint_velocity": qvel[:, max(free - 1, 0) :]}
        given = {**joints, **bodies(qpos, qvel, hinges), **given}  # what the file says itself counts
    live = {mit.VELOCITY_COMMAND: 3, mit.BASE_LINEAR_VELOCITY: 3, mit.ANCHOR_POSE: 7, mit.KEY_PRESSED: None}
    live |= {point_velocity(point): 3 for point in contract.velocity_points}
    if contract.height_scan is not None:
        live[mit.HEIGHT_SCAN] = contract.height_scan.count
    for term in contract.terms:
        array = contract.kind(term).input(term)
        if array in live and array not in given:
            raise FieldError(f"{array} is missing, expected it, as the policy observes {term.name}, or --robot")
    given = {"imu_linear_acceleration": np.zeros((steps, 3)), **given}
    widths: dict[str, int | None] = dict(zip(STATE_ARRAYS, (count, count, 4, 3, 3), strict=True))
    widths |= {"observation": None, "action": contract.action_count}
    widths |= {"target": count} if "target" in given else {}
    arrays: dict[str, npt.NDArray[Any]] = {key: _table(given, key, steps, width) for key, width in widths.items()}
    arrays |= {EXTERN + key: _table(given, key, steps, width) for key, width in live.items() if key in given}
    columns = [i for i, joint in enumerate(hinges) if joint in contract.joint_names]
    for key in {"joint_position", "joint_velocity", "target"} & arrays.keys():
        arrays[key] = arrays[key][:, columns]
    for key in given.keys() & set(_MEMORY):
        arrays[key] = np.broadcast_to(given[key], (steps, 7)) if given[key].shape == (7,) else given[key]
        if len(np.atleast_1d(arrays[key])) != steps:
            raise FieldError(f"{key} has shape {arrays[key].shape}, expected {steps} rows")
    typed = {key: array.astype(array_type(key)) for key, array in arrays.items()}
    return Trace(name, tuple(hinges[i] for i in columns), typed)


def _table(arrays: Arrays, name: str, steps: int, width: int | None) -> FloatArray:
    if name not in arrays:
        raise FieldError(f"{name} is missing, expected a row for each step")
    values: FloatArray = arrays[name].astype(np.float64)
    if values.ndim == 1 and len(values) == width:
        values = np.broadcast_to(values, (steps, width))
    if values.ndim != 2 or len(values) != steps or width not in (None, values.shape[1]):
        raise FieldError(f"{name} has shape {values.shape}, expected ({steps}, {width or 'width'})")
    if not np.isfinite(values).all():
        raise FieldError(f"{name} is not finite in row {int(np.argmax(~np.isfinite(values).all(axis=1)))}")
    return values
