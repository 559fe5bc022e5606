"""A trainer's own program, in plain NumPy: a policy for a robot of four joints, and a run of it.

Nothing here is shared with the package's observation code, so that agreement with it means something.
"""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from models import contract_of, linear_model, saved

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, Term
from humanoid_sim.policy.readers.own import STAMP_KEY, encode, write_metadata

JOINTS = ("left_hip", "right_hip", "left_knee", "right_knee")
DRIVEN = ("right_knee", "left_hip", "right_hip")
ROBOT_JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
DEFAULT = np.array([-0.2, 0.1, 0.6, 0.5])
SCALE = np.array([0.25, 0.5, 0.35])
HISTORY = 3
PERIOD = 0.8
DT = 0.02
WIDTH = 3 + 3 + 3 + 4 * HISTORY + 4 + 3 + 2 + 2
LEG = """
<body name="{0}_thigh" pos="0 {1} 0">
  <joint name="{0}_hip" axis="0 1 0" range="-1.5 1.5" armature="0.01"/>
  <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3" mass="1"/>
  <body name="{0}_shank" pos="0 0 -0.3">
    <joint name="{0}_knee" axis="0 1 0" range="-0.1 2" armature="0.01"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3" mass="1"/>
  </body>
</body>"""
MJCF = f"""
<mujoco model="walker">
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <body name="pelvis" pos="0 0 0.8">
      <freejoint name="root"/>
      <geom size="0.1" mass="8"/>
      {LEG.format("left", 0.1)}
      {LEG.format("right", -0.1)}
    </body>
  </worldbody>
</mujoco>
"""


def contract(**changes: Any) -> PolicyContract:
    """How the policy is wired."""
    values: dict[str, Any] = {
        "action_joint_names": DRIVEN,
        "joint_stiffness": [40.0, 41.0, 50.0, 51.0],
        "joint_damping": [1.5, 1.6, 2.0, 2.1],
        "default_joint_pos": DEFAULT,
        "observation": terms(),
        "command_names": ("twist",),
        "action_scale": SCALE,
        "policy_dt": DT,
        "command_ranges": [[-1.0, 1.0], [-0.5, 0.5], [-1.0, 1.0]],
        "phase": PhaseRule(PERIOD),
    }
    return contract_of(changes.pop("joint_names", JOINTS), **{**values, **changes})


def terms(**changes: dict[str, Any]) -> list[Term]:
    """The observation, with options of some terms changed."""
    options: dict[str, dict[str, Any]] = {
        "base_ang_vel": {"scale": 0.25},
        "projected_gravity": {},
        "velocity_commands": {},
        "joint_pos_rel": {"history": HISTORY},
        "joint_vel_rel": {"scale": 0.05},
        "last_action": {},
        "sin_phase": {},
        "cos_phase": {},
    }
    return [Term(name, **{**values, **changes.get(name, {})}) for name, values in options.items()]


def network() -> np.ndarray:
    """The weights of the policy, shape (WIDTH, 3)."""
    return np.random.default_rng(5).normal(0.0, 0.2, (WIDTH, len(DRIVEN))).astype(np.float32)


def save_checkpoint(path: Path, wiring: PolicyContract | None = None) -> Path:
    """Export the policy with its contract."""
    wiring = contract() if wiring is None else wiring
    return saved(path, linear_model({**write_metadata(wiring), STAMP_KEY: encode(wiring)}, matrix=network()))


class Run:
    """A run; every array has one row per step."""

    steps = 30

    def __init__(self) -> None:
        rng = np.random.default_rng(11)
        time = DT * np.arange(self.steps)[:, None]
        q, qd = DEFAULT + 0.3 * np.sin(6.0 * time + np.arange(4)), 1.8 * np.cos(6.0 * time + np.arange(4))
        quaternion = np.array([0.6, 0.05, -0.1, 0.7]) + 0.05 * rng.normal(size=(self.steps, 4))
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        position, order = np.array([0.3, -0.2, 0.8]) + 0.01 * time, [JOINTS.index(name) for name in ROBOT_JOINTS]
        self.qpos = np.concatenate([position, quaternion, q[:, order]], axis=1)
        self.qvel = np.concatenate([rng.normal(size=(self.steps, 6)), qd[:, order]], axis=1)
        self.cmd = np.array([0.5, -0.1, 0.3])
        last, relative, actions, observations = np.zeros(3, dtype=np.float32), q - DEFAULT, [], []
        for k in range(self.steps):
            gravity = _rotation(quaternion[k]).T @ np.array([0.0, 0.0, -1.0])
            angles = 2.0 * np.pi * DT / PERIOD * (k + 1) + np.array([0.0, np.pi])
            past = [relative[max(k - back, 0)] for back in reversed(range(HISTORY))]
            parts = [0.25 * self.qvel[k, 3:6], gravity, self.cmd, *past, 0.05 * qd[k], last]
            observations.append(np.concatenate([*parts, np.sin(angles), np.cos(angles)]).astype(np.float32))
            last = observations[-1] @ network()
            actions.append(last)
        self.obs, self.action = np.stack(observations), np.stack(actions)
        self.target = np.zeros((self.steps, 4))
        for a, name in enumerate(DRIVEN):
            self.target[:, ROBOT_JOINTS.index(name)] = DEFAULT[JOINTS.index(name)] + SCALE[a] * self.action[:, a]


def save_trace(path: Path, run: Run, **changes: np.ndarray | None) -> Path:
    """Write a run; a change of None leaves the array out."""
    names = ("qpos", "qvel", "obs", "action", "cmd", "target")
    joints = {"joint_names": np.array(["root", *ROBOT_JOINTS])}
    arrays = {**{name: getattr(run, name) for name in names}, **joints, **changes}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
