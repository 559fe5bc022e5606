"""A motion that a model carries in its graph: `time_step` in, the reference of that frame out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import FieldError, blaming, reason_of
from humanoid_sim.mit import Float32Array
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.onnx_policy import OnnxPolicy

_JOINTS = ("joint_pos", "joint_vel")
_BODIES = ("body_pos_w", "body_quat_w")
_HELD = 50  # equal frames in a row after which the end is looked for: graphs hold their last frame
_PROBE = 25  # stride, frames, that distinguishes a pause from the end
_LONGEST = 90_000  # frames, half an hour at 50 Hz: whatever goes on beyond is not a motion that ends


def sweep_motion(policy: OnnxPolicy, contract: PolicyContract) -> Motion | None:
    """Read the motion frame by frame, up to where the outputs stop changing; None where none is in the graph."""
    available = {tensor.name for tensor in policy.model.outputs}
    if not (policy.has_time_step and contract.task_type == "tracking" and available.issuperset(_JOINTS)):
        return None
    joints, bodies = contract.joint_names, contract.body_names if available.issuperset(_BODIES) else ()
    sizes = dict.fromkeys(_JOINTS, len(joints))
    sizes |= dict(zip(_BODIES, (3 * len(bodies), 4 * len(bodies)), strict=True)) if bodies else {}
    observation = np.zeros(policy.observation_width, dtype=np.float32)

    def frame(index: int) -> Float32Array | None:
        try:
            answer = policy.run(list(sizes), observation, index)
        except Exception as error:  # onnxruntime's own types
            if index == 0 or isinstance(error, TimeoutError):
                raise FieldError(f"the motion in its graph cannot be read: {reason_of(error)}") from None
            return None  # a graph that does not hold its last frame has none beyond it
        values = [np.asarray(value, np.float32).ravel() for value in answer]
        for (name, size), value in zip(sizes.items(), values, strict=True):
            if value.size != size:
                raise FieldError(f"output '{name}' has {value.size} values, expected {size}")
        if bodies and contract.reference_quaternion == "xyzw":
            values[-1] = values[-1].reshape(-1, 4)[:, [3, 0, 1, 2]].ravel()
        return np.concatenate(values)

    with blaming(policy.model.path):
        rows = np.stack(_rows(frame))
        return Motion(rows, bodies, contract.policy_dt, layout="joints_bodies_w", joint_names=joints)


def _rows(frame: Callable[[int], Float32Array | None]) -> list[Float32Array]:
    rows: list[Float32Array] = []
    held = 0
    while (row := frame(len(rows))) is not None:
        held = held + 1 if rows and np.array_equal(row, rows[-1], equal_nan=True) else 0
        rows.append(row)
        if held >= _HELD:
            later = (frame(index) for index in range(len(rows), _LONGEST, _PROBE))
            if all(other is not None and np.array_equal(row, other, equal_nan=True) for other in later):
                return rows[:-_HELD]
        if len(rows) >= _LONGEST:
            raise FieldError(f"the motion in its graph still changes after {_LONGEST} frames")
    return rows
