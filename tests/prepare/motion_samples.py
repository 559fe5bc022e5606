"""Small motions of the Lite in the formats of others, made from its own forward kinematics."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.controllers.rotation import quaternion_from_matrix
from humanoid_sim.policy.motion import body_frames
from humanoid_sim.prepare import main
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics

POLICY = asset_path("policies", "lite_tracking.onnx")
FPS = 50.0
FRAMES = 40
BODIES = ("left_elbow_pitch", "left_hand", "right_elbow_pitch", "right_hand")
"""That the sample policy tracks."""


@cache
def lite() -> RobotDescription:
    return load_robot("lite")


def pose_a(description: RobotDescription) -> np.ndarray:
    """Shape (n,), rad: the last pose of standby A."""
    return np.array(description.standby_controller_a.pose_segments[-1])


def joint_frames(description: RobotDescription, path: np.ndarray) -> np.ndarray:
    """Shape (F, 9 B): poses of `BODIES` in the base frame along a joint path (F, n), rad."""
    return body_frames(*ForwardKinematics(description, BODIES)(path)).astype(np.float32)


def joint_path(frames: int = FRAMES, seed: int = 0) -> np.ndarray:
    """Shape (F, 14), rad: every joint moves, each in its own way, and stays within its limits."""
    description = lite()
    home = pose_a(description)
    rng = np.random.default_rng(seed)
    room = 0.6 * np.minimum(np.minimum(description.upper - home, home - description.lower), 0.8)
    t = np.arange(frames)[:, None] / FPS
    return home + room * np.sin(2 * np.pi * rng.uniform(0.4, 1.4, 14) * t + rng.uniform(0, 2 * np.pi, 14))


def state_of(q: np.ndarray, bodies: tuple[str, ...], fps: float = FPS) -> dict[str, Any]:
    """The arrays of an .npz: a robot whose base stands, turned, somewhere in the world."""
    position, rotation = ForwardKinematics(lite(), bodies)(q)
    cos, sin = np.cos(0.7), np.sin(0.7)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return {
        "fps": np.array([fps]),
        "joint_pos": q.astype(np.float32),
        "joint_vel": np.gradient(q, 1.0 / fps, axis=0).astype(np.float32),
        "body_pos_w": (position @ turn.T + np.array([1.0, 2.0, 0.5])).astype(np.float32),
        "body_quat_w": quaternion_from_matrix(turn @ rotation).astype(np.float32),
    }


def write_npz(path: Path, state: dict[str, Any], **changes: Any) -> Path:
    """Changes replace arrays, and None removes one."""
    np.savez(path, **{key: value for key, value in (state | changes).items() if value is not None})
    return path


def prepare(folder: Path, motion: Path | str, *options: str) -> int:
    """Run `prepare` for the sample policy, into `out` of the folder; its exit status."""
    given = ["--policy", str(POLICY), "--motion", str(motion), "--output", str(folder / "out")]
    return run_program(main, [*given, *options])


def refusal(capsys: Any, folder: Path, motion: Path | str, *options: str) -> str:
    """The one line of a refused run."""
    capsys.readouterr()
    assert prepare(folder, motion, *options) == 2
    error: str = capsys.readouterr().err
    assert error.count("\n") == 1
    return error
