"""A run of the piano policy as its trainer sees it, for golden vectors: `policy stamp --trace`.

Observation, action and control law stand here once more and come from no module that the robot's controllers use: that
is what makes their agreement worth something.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.assets import SAMPLE_SONG, song_path
from humanoid_sim.evaluation.key_poses import ABOVE, KeyPoses
from humanoid_sim.evaluation.piano_player import HOME
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.onnx_policy import onnx_runtime
from humanoid_sim.policy.song import playable, read_song, song_motion
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.mjcf import mujoco_silenced
from humanoid_sim.robots.piano import TRIGGER, key_joint_names
from humanoid_sim.simulation.model import build_model, joint_addresses

__all__ = ["piano_run", "write_piano_trace"]

Arrays = dict[str, npt.NDArray[Any]]

_POLICY_DT = 0.02
_AHEAD = (0, *range(1, 13), *range(14, 31, 2), *range(35, 61, 5))
"""Steps at which the song is observed."""
_SECONDS = 8.0
"""s of the song: with keys of both hands down, and none."""
_OFF = 0.01
"""rad by which each joint starts off the default pose: the hands are above the keys all the same."""


def write_piano_trace(checkpoint: Path, output: Path) -> int:
    """Write the trace of a checkpoint; returns the exit status.

    Raises `InputError` if a file cannot be read or written.
    """
    output_file(output, "--output", ".npz")
    description = load_robot("lite_piano")
    played, _ = playable(read_song(song_path(SAMPLE_SONG)), description)
    motion = song_motion(played, _POLICY_DT, description)
    run = piano_run(checkpoint, description, motion.frames)
    with whole_file(output) as file:
        np.savez_compressed(file, **run)  # type: ignore[arg-type]  # which has a bool among its keywords
    print(f"{output}: {len(run['obs'])} policy steps of {checkpoint} along {SAMPLE_SONG}")
    return 0


def piano_run(
    checkpoint: Path,
    description: RobotDescription,
    table: npt.NDArray[np.floating],
    seconds: float = _SECONDS,
    seed: int = 0,
) -> Arrays:
    """Return the arrays of a trace, as `docs/golden-vectors.md` lists them, one row per policy step.

    Args:
        checkpoint: of a network from `export_piano_policy`.
        description: of the Lite with a piano.
        table: shape (F, 88), 0 or 1: the goals of the song, one row per policy step.
        seconds: s of the song.
        seed: of the start.
    """
    default = _default_pose(description)
    session = onnx_runtime().InferenceSession(str(checkpoint), providers=["CPUExecutionProvider"])
    model = build_model(description, scene=False)
    data = mujoco.MjData(model)
    joints = joint_addresses(model, description.joint_names)
    keys = joint_addresses(model, key_joint_names()).qpos
    sounds = TRIGGER * model.jnt_range[[model.joint(name).id for name in key_joint_names()], 1]
    stiffness, damping, limit = (
        np.array(values) for values in (description.stiffness, description.damping, description.effort_limit)
    )
    rng = np.random.default_rng(seed)
    data.qpos[joints.qpos] = default + _OFF * rng.normal(size=len(default))
    action = np.zeros(len(default), dtype=np.float32)
    names = ("obs", "action", "qpos", "qvel", "target", "key_pressed")
    rows: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in names}
    for frame in range(min(round(seconds / _POLICY_DT), len(table))):
        q, qd = data.qpos[joints.qpos].copy(), data.qvel[joints.dof].copy()
        down = (data.qpos[keys] > sounds).astype(np.float64)
        ahead = [table[min(frame + offset, len(table) - 1)] for offset in _AHEAD]
        obs = np.concatenate([action, down, *ahead]).astype(np.float32)
        action = session.run(None, {"obs": obs[None]})[0][0]
        target = default + action.astype(np.float64)
        for name, row in zip(names, (obs, action, q, qd, target, down), strict=True):
            rows[name].append(row)
        for _ in range(round(_POLICY_DT / model.opt.timestep)):
            effort = stiffness * (target - data.qpos[joints.qpos]) - damping * data.qvel[joints.dof]
            data.qfrc_applied[joints.dof] = np.clip(effort, -limit, limit)
            with mujoco_silenced:
                mujoco.mj_step(model, data)
    return {name: np.stack(values) for name, values in rows.items()} | {
        "joint_names": np.array(description.joint_names)
    }


def _default_pose(description: RobotDescription) -> FloatArray:
    """Shape (14,), rad: each hand above the key where it is at home."""
    poses = KeyPoses.of(description, range(min(HOME), max(HOME) + 1))
    default = np.empty(description.joint_count)
    for hand, key in enumerate(HOME):
        default[poses.arms[hand]] = poses.table[hand, ABOVE, key]
    return default
