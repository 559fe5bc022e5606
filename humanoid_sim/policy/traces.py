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
_MEMORY: Mapping[str, type[np.generic]] = {
    **{"last_action": np.float32, "frame": np.int64, "walked": np.float64},
    **{"history": np.float32, "alignment": np.float64},
}


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
        for name in {"history", "alignment"} & known.keys():
            if np.isnan(known[name]).any():
                known[name] = None
        if known.get("alignment") is not None:
            known["alignment"] = Alignment(yaw=known["alignment"][3:], offset=known["alignment"][:3])
        return replace(memory, **known)


def read_trace(path: Path, contract: PolicyContract, bodies: BodyReader | None = None) -> Trace:
    """Read a trace for a policy; joints that the policy does not have are left out.

    Raises `InputError` with the array that is wrong. `bodies` is of the robot that the trace is of, for `qpos`.
    """
    given = {_NAMES.get(name, name): array for name, array in read_arrays(path).items()}
    with blaming(path):
        return _trace(path.name, given, contract, bodies)


def _trace(name: str, given: Arrays, contract: PolicyContract, bodies: BodyReader | None) -> Trace:
    action = _table(given, "action", None, contract.action_count)
    steps, names = len(action), _joint_names(given)
    # A free joint has 7 values, and any other 1; it has a name of its own, or none.
    surplus = given["qpos"].shape[-1] - len(names) if "qpos" in given else 0
    hinges = names[1:] if surplus == 6 else names
    missing = [name for name in contract.joint_names if name not in hinges]
    if missing:
        raise FieldError(f"joint_names lacks {', '.join(missing)}, expected every joint of the policy")
    known = _states(given, steps, hinges, 7 if surplus in (6, 7) else 0, bodies)
    widths = {mit.VELOCITY_COMMAND: 3, mit.BASE_LINEAR_VELOCITY: 3, mit.ANCHOR_POSE: 7}
    widths |= {point_velocity(point): 3 for point in contract.velocity_points}
    if contract.height_scan is not None:
        widths[mit.HEIGHT_SCAN] = contract.height_scan.count
    live = (*widths, mit.KEY_PRESSED)
    # What the file says itself comes before what follows from its qpos.
    stated = [name for name in (*live, *STATE_ARRAYS[2:]) if name in given]
    known |= {name: _table(given, name, steps, widths.get(name)) for name in stated}
    for term in contract.terms:
        array = contract.kind(term).input(term)
        if array and array not in known:
            raise FieldError(f"{array} is missing, expected it, as the policy observes {term.name}, or --robot")
    columns = [i for i, joint in enumerate(hinges) if joint in contract.joint_names]
    known.setdefault("imu_linear_acceleration", np.zeros((steps, 3)))
    arrays: dict[str, npt.NDArray[Any]] = {name: known[name] for name in STATE_ARRAYS}
    arrays |= {name: known[name][:, columns] for name in STATE_ARRAYS[:2]}
    arrays |= {EXTERN + name: known[name] for name in live if name in known}
    arrays["observation"] = _table(given, "observation", steps).astype(np.float32)
    arrays["action"] = action.astype(np.float32)
    if "target" in given:
        arrays["target"] = _table(given, "target", steps, len(hinges))[:, columns]
    for part in _MEMORY.keys() & given.keys():
        values = np.broadcast_to(given[part], (steps, 7)) if given[part].shape == (7,) else given[part]
        if len(np.atleast_1d(values)) != steps:
            raise FieldError(f"{part} has shape {values.shape}, expected {steps} rows")
        arrays[part] = values.astype(_MEMORY[part])
    return Trace(name, tuple(hinges[i] for i in columns), arrays)


def _table(arrays: Arrays, name: str, steps: int | None, width: int | None = None) -> FloatArray:
    """Return an array as shape (steps, width), float64; one row for all steps is spread out."""
    values = arrays.get(name)
    if values is None or values.dtype.kind not in "fiub":
        problem = "is missing" if values is None else f"has type {values.dtype}"
        raise FieldError(f"{name} {problem}, expected numbers, a row for each step")
    if values.ndim == 1 and steps is not None and name != "observation":
        values = np.broadcast_to(values, (steps, len(values)))
    is_row = values.ndim == 2 and len(values) > 0 and width in (None, values.shape[1])
    if not is_row or steps not in (None, len(values)):
        raise FieldError(f"{name} has shape {values.shape}, expected ({steps or 'F'}, {width or 'width'})")
    if not np.isfinite(values).all():
        raise FieldError(f"{name} is not finite in row {int(np.argmax(~np.isfinite(values).all(axis=1)))}")
    return values.astype(np.float64)


def _joint_names(arrays: Arrays) -> tuple[str, ...]:
    names = arrays.get("joint_names")
    if names is None or names.ndim != 1 or names.dtype.kind not in "US" or len(set(names.tolist())) < len(names):
        shown = "is missing" if names is None else f"has shape {names.shape}, type {names.dtype}"
        raise FieldError(f"joint_names {shown}, expected one text per joint, none twice, in the order of the state")
    return tuple(names.astype(str).tolist())


def _states(
    given: Arrays, steps: int, hinges: tuple[str, ...], free: int, bodies: BodyReader | None
) -> dict[str, FloatArray]:
    """Return what a run says of the robot: as arrays, or as it follows from `qpos` and `qvel` by the robot's model."""
    joints, speeds = len(hinges), max(free - 1, 0)
    if "qpos" not in given:
        widths = zip(STATE_ARRAYS, (joints, joints, 4, 3), strict=False)
        return {name: _table(given, name, steps, width) for name, width in widths}
    if bodies is None:
        raise FieldError("qpos needs the trainer's robot, whose model says where its IMU is: --robot")
    qpos, qvel = _table(given, "qpos", steps, free + joints), _table(given, "qvel", steps, speeds + joints)
    found = {"joint_position": qpos[:, free:], "joint_velocity": qvel[:, speeds:]}
    return found | dict(bodies(qpos, qvel, hinges))
