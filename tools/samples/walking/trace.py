"""A run of the walking policy as its trainer sees it, for golden vectors: `policy stamp --trace`.

Observation, clock, action and control law stand here once more and come from no module that the robot's controllers
use: that is what makes their agreement worth something.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.files import output_file, whole_file
from humanoid_sim.policy.onnx_policy import onnx_runtime
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.model import build_model, joint_addresses

__all__ = ["walking_run", "write_walking_trace"]

Arrays = dict[str, npt.NDArray[Any]]

_POLICY_DT = 0.02
_PERIOD = 0.64
_ACTION = 0.25
_STIFFNESS, _DAMPING = 80.0, 2.0
_STANDING = np.array([-0.1745, 0.0, 0.0, 0.3491, 0.0, -0.1745, 0.0] * 2)
_COMMANDS = ((0.0, 0.0, 0.0), (0.3, 0.1, -0.2), (-0.2, -0.1, 0.4))
"""One after the other; the first is to stand."""
_STEPS_EACH = 50
_YAW = 0.9
"""rad, heading at the start: no frame is another by chance."""


def write_walking_trace(checkpoint: Path, output: Path) -> int:
    """Write the trace of a checkpoint; returns the exit status.

    Raises `InputError` if a file cannot be read or written.
    """
    output_file(output, "--output", ".npz")
    run = walking_run(checkpoint, load_robot("lite_biped"))
    with whole_file(output) as file:
        np.savez_compressed(file, **run)  # type: ignore[arg-type]  # which has a bool among its keywords
    print(f"{output}: {len(run['obs'])} policy steps of {checkpoint}")
    return 0


def walking_run(checkpoint: Path, description: RobotDescription, seed: int = 0) -> Arrays:
    """Return the arrays of a trace, as `docs/golden-vectors.md` lists them, one row per policy step.

    Args:
        checkpoint: of a network from `export_walking`.
        description: of the legs.
        seed: of the start.
    """
    session = onnx_runtime().InferenceSession(str(checkpoint), providers=["CPUExecutionProvider"])
    model = build_model(description, scene="floor")
    data = mujoco.MjData(model)
    joints, limit = joint_addresses(model, description.joint_names), np.array(description.effort_limit)
    rng, n = np.random.default_rng(seed), len(_STANDING)
    data.qpos[2] += 0.002
    data.qpos[3:7] = np.cos(_YAW / 2), 0.0, 0.0, np.sin(_YAW / 2)
    data.qpos[joints.qpos] = _STANDING + 0.03 * rng.normal(size=n)
    data.qvel[joints.dof] = 0.05 * rng.normal(size=n)
    data.eq_active[:] = 0  # nothing holds it
    action, turned = np.zeros(n, dtype=np.float32), 0.0
    names = ("obs", "action", "qpos", "qvel", "target", "cmd", "walked")
    rows: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in names}
    base = 7 + n
    for command in np.repeat(np.array(_COMMANDS), _STEPS_EACH, axis=0):
        q, qd = data.qpos[joints.qpos].copy(), data.qvel[joints.dof].copy()
        frame = np.zeros(9)
        mujoco.mju_quat2Mat(frame, data.qpos[3:7])
        down = -frame.reshape(3, 3)[2]
        before = turned
        turned = turned + 2.0 * np.pi * _POLICY_DT / _PERIOD
        clock = np.sin(turned), np.cos(turned)
        spin = 0.25 * data.qvel[3:6]
        obs = np.concatenate([spin, down, command, q - _STANDING, 0.05 * qd, action, clock]).astype(np.float32)
        row_qpos = np.concatenate([data.qpos[:7], q])
        row_qvel = np.concatenate([data.qvel[:6], qd])
        action = session.run(None, {"obs": obs[None]})[0][0]
        target = _STANDING + _ACTION * action.astype(np.float64)
        values = (obs, action, row_qpos[:base], row_qvel, target, command, np.array(before))
        for name, row in zip(rows, values, strict=True):
            rows[name].append(row)
        for _ in range(round(_POLICY_DT / model.opt.timestep)):
            effort = _STIFFNESS * (target - data.qpos[joints.qpos]) - _DAMPING * data.qvel[joints.dof]
            data.qfrc_applied[joints.dof] = np.clip(effort, -limit, limit)
            mujoco.mj_step(model, data)
    return {name: np.stack(values) for name, values in rows.items()} | {
        "joint_names": np.array(description.joint_names)
    }
