"""A motion that a model carries in its graph: `time_step` in, the reference of that frame out."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.mit import Float32Array
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.onnx_policy import OnnxPolicy, first_line
from humanoid_sim.policy.readers.partial import PartialContract, assumed

_Frame = Callable[[int], Float32Array | None]
_JOINTS = ("joint_pos", "joint_vel")
_BODIES = ("body_pos_w", "body_quat_w")
_ANCHOR = ("ref_pos_xyz", "ref_quat_xyzw")
"""holosoma gives the anchor body alone; trackers that do not observe its position, without that."""
_HELD = 50
"""Equal frames in a row after which the end is looked for: graphs hold their last frame from there on."""
_PROBE = 25
"""Stride, frames, with which a pause is told from the end."""
_LONGEST = 90_000
"""Frames, half an hour at 50 Hz: whatever goes on beyond is not a motion that ends."""


def graph_conventions(outputs: Collection[str]) -> PartialContract:
    """Return what the names of a model's outputs imply for its contract."""
    source = f"output {_ANCHOR[1]}"
    implied = {"reference_quaternion": "xyzw"} if _ANCHOR[1] in outputs else {}
    return PartialContract(source, assumed=assumed(source, implied))


def sweep_motion(policy: OnnxPolicy, contract: PolicyContract) -> Motion | None:
    """Read the motion frame by frame, up to where the outputs stop changing; None where none is in the graph.

    Raises `InputError` if the outputs do not fit the contract, or never end.

    Args:
        policy: its outputs `joint_pos` and `joint_vel` are in the policy's joint order, `body_pos_w` and `body_quat_w`
            in the order of the contract's `body_names`; `ref_pos_xyz` and `ref_quat_xyzw` are of its anchor body.
        contract: of the policy; `reference_quaternion` says in which order the quaternions are.

    Returns:
        A motion of layout `joints_bodies_w`, float32 as the graph gives it, quaternions w x y z.
    """
    path = policy.model.path
    available = {tensor.name for tensor in policy.model.outputs}
    if not (policy.has_time_step and contract.task_type == "tracking" and available.issuperset(_JOINTS)):
        return None
    bodies = contract.body_names if available.issuperset(_BODIES) else ()
    outputs = [*_JOINTS, *(_BODIES if bodies else ())]
    if not bodies and contract.anchor_body and _ANCHOR[1] in available:
        bodies = (contract.anchor_body,)
        outputs += [name for name in _ANCHOR if name in available]
        if _ANCHOR[0] not in available and any(term.kind == "motion_anchor_pos" for term in contract.terms):
            raise InputError(f"{path}: observes the anchor's position, but its model has no output '{_ANCHOR[0]}'")
    if contract.anchor_body and bodies and contract.anchor_body not in bodies:
        raise InputError(
            f"{path}: anchor_body is '{contract.anchor_body}', expected one of body_names: {', '.join(bodies)}"
        )
    observation = np.zeros(policy.observation_width, dtype=np.float32)

    def frame(index: int) -> Float32Array | None:
        try:
            answer = policy.run(outputs, observation, index)
        except Exception as error:  # onnxruntime's own types
            if index == 0 or isinstance(error, TimeoutError):
                raise InputError(f"{path}: the motion in its graph cannot be read: {first_line(error)}") from None
            return None  # a graph that does not hold its last frame has none beyond it
        return _row(dict(zip(outputs, answer, strict=True)), contract, len(bodies), str(path))

    rows = _rows(frame, str(path))
    with blaming(f"{path}: motion in its graph"):
        return Motion(
            frames=np.stack(rows),
            body_names=bodies,
            policy_dt=contract.policy_dt,
            layout="joints_bodies_w",
            joint_names=contract.joint_names,
        )


def _rows(frame: _Frame, path: str) -> list[Float32Array]:
    """All frames up to the first of those that never change again."""
    rows: list[Float32Array] = []
    end = 0
    while True:
        row = frame(len(rows))
        if row is None:
            return rows
        if rows and not _same(row, rows[-1]):
            end = len(rows)
        rows.append(row)
        if len(rows) - end > _HELD and _is_end(frame, rows):
            return rows[: end + 1]
        if len(rows) >= _LONGEST:
            raise InputError(f"{path}: the motion in its graph still changes after {_LONGEST} frames")


def _is_end(frame: _Frame, rows: list[Float32Array]) -> bool:
    """Return whether the last frame is held from here on, as far as a look at every so many frames tells."""
    if (len(rows) - 1) % _HELD:  # a long pause is looked beyond now and then, not at each of its frames
        return False
    later = (frame(index) for index in range(len(rows), _LONGEST, _PROBE))
    return all(row is not None and _same(row, rows[-1]) for row in later)


def _same(row: Float32Array, other: Float32Array) -> bool:
    return np.array_equal(row, other, equal_nan=True)


def _row(values: dict[str, Float32Array], contract: PolicyContract, bodies: int, path: str) -> Float32Array:
    joints = len(contract.joint_names)
    parts = [_flat(values, name, joints, path) for name in _JOINTS]
    if _BODIES[0] in values:
        quaternions = _flat(values, _BODIES[1], 4 * bodies, path).reshape(-1, 4)
        parts += [_flat(values, _BODIES[0], 3 * bodies, path), _wxyz(quaternions, contract.reference_quaternion)]
    elif bodies:
        has_position = _ANCHOR[0] in values
        parts.append(_flat(values, _ANCHOR[0], 3, path) if has_position else np.zeros(3, dtype=np.float32))
        parts.append(_wxyz(_flat(values, _ANCHOR[1], 4, path).reshape(-1, 4), contract.reference_quaternion))
    return np.concatenate(parts)


def _flat(values: dict[str, Float32Array], name: str, size: int, path: str) -> Float32Array:
    value = np.asarray(values[name], dtype=np.float32).ravel()
    if value.shape != (size,):
        raise InputError(f"{path}: output '{name}' has {value.size} values, expected {size}")
    return value


def _wxyz(quaternions: Float32Array, order: str) -> Float32Array:
    return (quaternions if order == "wxyz" else quaternions[:, [3, 0, 1, 2]]).ravel()
