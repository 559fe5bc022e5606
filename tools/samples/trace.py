"""A run of the sample policy as its trainer sees it, for golden vectors: `policy stamp --trace`.

Observation, action and control law stand here once more, as the network was trained on them (see `student.py`), and
come from no module that the robot's controllers use: that is what makes their agreement worth something.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.assets import SAMPLE_MOTION, motion_path
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.policy.onnx_policy import onnx_runtime
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.mjcf import mujoco_silenced
from humanoid_sim.simulation.model import build_model, joint_addresses
from tools.samples import scales
from tools.samples.motions import POLICY_DT, pose_a

__all__ = ["trainer_run", "write_trace"]

Arrays = dict[str, npt.NDArray[Any]]

_SECONDS = 4.0
"""s of the motion: from rest, through its fastest stretches."""
_OFF = 0.05
"""rad by which each joint starts off the default pose, and rad/s off rest: no term is zero at the start."""


def write_trace(checkpoint: Path, output: Path) -> int:
    """Write the trace of a checkpoint; returns the exit status.

    Raises `InputError` if a file cannot be read or written.
    """
    output_file(output, "--output", ".npz")
    run = trainer_run(checkpoint, load_robot("lite"), motion_path(SAMPLE_MOTION))
    with whole_file(output) as file:
        np.savez_compressed(file, **run)  # type: ignore[arg-type]  # which has a bool among its keywords
    print(f"{output}: {len(run['obs'])} policy steps of {checkpoint} along {SAMPLE_MOTION}")
    return 0


def trainer_run(checkpoint: Path, description: RobotDescription, motion: Path, seed: int = 0) -> Arrays:
    """Return the arrays of a trace, as `docs/golden-vectors.md` lists them, one row per policy step.

    Args:
        checkpoint: of a network from `export_policy`.
        description: of a robot with two of the Lite's arms.
        motion: that it follows.
        seed: of the start.
    """
    session = onnx_runtime().InferenceSession(str(checkpoint), providers=["CPUExecutionProvider"])
    model = build_model(description, scene=False)
    data = mujoco.MjData(model)
    joints = joint_addresses(model, description.joint_names)
    stiffness, damping, limit = (
        np.array(values) for values in (description.stiffness, description.damping, description.effort_limit)
    )
    frames = read_motion(motion).frames[: round(_SECONDS / POLICY_DT)]
    default, rng = pose_a(description), np.random.default_rng(seed)
    data.qpos[joints.qpos] = default + _OFF * rng.normal(size=len(default))
    data.qvel[joints.dof] = _OFF * rng.normal(size=len(default))
    action = np.zeros(len(default), dtype=np.float32)
    rows: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in ("obs", "action", "qpos", "qvel", "target")}
    for frame in frames:
        q, qd = data.qpos[joints.qpos].copy(), data.qvel[joints.dof].copy()
        obs = np.concatenate([frame, q - default, qd, action]).astype(np.float32)
        action = session.run(None, {"obs": obs[None]})[0][0]
        target = default + scales.ACTION * action.astype(np.float64)
        for name, row in zip(rows, (obs, action, q, qd, target), strict=True):
            rows[name].append(row)
        for _ in range(round(POLICY_DT / model.opt.timestep)):
            effort = stiffness * (target - data.qpos[joints.qpos]) - damping * data.qvel[joints.dof]
            data.qfrc_applied[joints.dof] = np.clip(effort, -limit, limit)
            with mujoco_silenced:
                mujoco.mj_step(model, data)
    return {name: np.stack(values) for name, values in rows.items()} | {
        "joint_names": np.array(description.joint_names)
    }
