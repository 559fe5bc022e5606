"""A motion that a model carries in its graph: `time_step` in, the reference of that frame out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.onnx_model import OnnxModel

__all__ = ["GraphPolicy", "Progress", "has_graph_motion", "sweep_motion"]

Progress = Callable[[int], None]
"""Told the number of frames that have been read so far."""

_JOINTS = ("joint_pos", "joint_vel")
_BODIES = ("body_pos_w", "body_quat_w")
_ANCHOR = ("ref_pos_xyz", "ref_quat_xyzw")
"""holosoma gives the anchor body alone, and its quaternion as x y z w."""
_HELD = 50
"""Equal frames in a row that count as the end: graphs hold their last frame from there on."""
_LONGEST = 360_000
"""Frames, two hours at 50 Hz: whatever goes on beyond is no motion that ends."""


class GraphPolicy(Protocol):
    """A policy whose model has more outputs than the action."""

    model: OnnxModel
    observation_width: int
    has_time_step: bool

    def run(
        self, outputs: list[str], observation: npt.NDArray[np.float32], frame: int
    ) -> list[npt.NDArray[np.float32]]:
        """Some outputs of one inference."""
        ...


def has_graph_motion(policy: GraphPolicy, contract: PolicyContract) -> bool:
    """Whether the model answers with a reference, and the contract follows one."""
    names = {tensor.name for tensor in policy.model.outputs}
    return policy.has_time_step and contract.task_type == "tracking" and names.issuperset(_JOINTS)


def sweep_motion(policy: GraphPolicy, contract: PolicyContract, progress: Progress | None = None) -> Motion:
    """Read the motion frame by frame, up to where the outputs stop changing.

    Args:
        policy: its outputs `joint_pos` and `joint_vel` are in the policy's joint order, `body_pos_w` and `body_quat_w`
            in the order of the contract's `body_names`; `ref_pos_xyz` and `ref_quat_xyzw` are of its anchor body.
        contract: of the policy; `reference_quaternion` says in which order `body_quat_w` is.
        progress: told after each frame.

    Returns:
        A motion of layout `joints_bodies_w`, float32 as the graph gives it, quaternions w x y z.

    Raises:
        InputError: if the outputs do not fit the contract, or never end.
    """
    path = policy.model.path
    available = {tensor.name for tensor in policy.model.outputs}
    bodies = contract.body_names if available.issuperset(_BODIES) else ()
    outputs = [*_JOINTS, *(_BODIES if bodies else ())]
    if not bodies and contract.anchor_body and _ANCHOR[1] in available:
        bodies = (contract.anchor_body,)
        outputs += [name for name in _ANCHOR if name in available]
    if contract.anchor_body and bodies and contract.anchor_body not in bodies:
        raise InputError(
            f"{path}: anchor_body is '{contract.anchor_body}', expected one of body_names: {', '.join(bodies)}"
        )
    observation = np.zeros(policy.observation_width, dtype=np.float32)
    rows: list[npt.NDArray[np.float32]] = []
    held = 0
    while held < _HELD:
        if len(rows) >= _LONGEST:
            raise InputError(f"{path}: the motion in its graph still changes after {_LONGEST} frames")
        values = dict(zip(outputs, policy.run(outputs, observation, len(rows)), strict=True))
        row = _row(values, contract, len(bodies), str(path))
        held = held + 1 if rows and np.array_equal(row, rows[-1]) else 0
        rows.append(row)
        if progress is not None:
            progress(len(rows))
    try:
        return Motion(
            frames=np.stack(rows[: len(rows) - _HELD]),
            body_names=bodies,
            policy_dt=contract.policy_dt,
            layout="joints_bodies_w",
            joint_names=contract.joint_names,
        )
    except FieldError as error:
        raise InputError(f"{path}: motion in its graph: {error}") from None


def _row(
    values: dict[str, npt.NDArray[np.float32]], contract: PolicyContract, bodies: int, path: str
) -> npt.NDArray[np.float32]:
    joints = len(contract.joint_names)
    parts = [_flat(values, name, joints, path) for name in _JOINTS]
    if _BODIES[0] in values:
        quaternions = _flat(values, _BODIES[1], 4 * bodies, path).reshape(-1, 4)
        parts += [_flat(values, _BODIES[0], 3 * bodies, path), _wxyz(quaternions, contract.reference_quaternion)]
    elif bodies:
        has_position = _ANCHOR[0] in values
        parts.append(_flat(values, _ANCHOR[0], 3, path) if has_position else np.zeros(3, dtype=np.float32))
        parts.append(_wxyz(_flat(values, _ANCHOR[1], 4, path).reshape(-1, 4), "xyzw"))
    return np.concatenate(parts)


def _flat(values: dict[str, npt.NDArray[np.float32]], name: str, size: int, path: str) -> npt.NDArray[np.float32]:
    value = np.asarray(values[name], dtype=np.float32).ravel()
    if value.shape != (size,):
        raise InputError(f"{path}: output '{name}' has {value.size} values, expected {size}")
    return value


def _wxyz(quaternions: npt.NDArray[np.float32], order: str) -> npt.NDArray[np.float32]:
    return (quaternions if order == "wxyz" else quaternions[:, [3, 0, 1, 2]]).ravel()
