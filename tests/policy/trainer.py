"""A trainer's own program, in plain NumPy: a policy for a robot of four joints, and a run of it.

Nothing here is shared with the package's observation code, so that agreement with it means something.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from models import finished
from onnx import TensorProto, helper, numpy_helper

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
MJCF = """
<mujoco model="walker">
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <body name="pelvis" pos="0 0 0.8">
      <freejoint name="root"/>
      <geom size="0.1" mass="8"/>
      <body name="left_thigh" pos="0 0.1 0">
        <joint name="left_hip" axis="0 1 0" range="-1.5 1.5" armature="0.01"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3" mass="1"/>
        <body name="left_shank" pos="0 0 -0.3">
          <joint name="left_knee" axis="0 1 0" range="-0.1 2" armature="0.01"/>
          <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3" mass="1"/>
        </body>
      </body>
      <body name="right_thigh" pos="0 -0.1 0">
        <joint name="right_hip" axis="0 1 0" range="-1.5 1.5" armature="0.01"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3" mass="1"/>
        <body name="right_shank" pos="0 0 -0.3">
          <joint name="right_knee" axis="0 1 0" range="-0.1 2" armature="0.01"/>
          <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.3" mass="1"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def contract(**changes: Any) -> PolicyContract:
    """How the policy is wired."""
    values: dict[str, Any] = {
        "task_type": "locomotion",
        "joint_names": JOINTS,
        "action_joint_names": DRIVEN,
        "joint_stiffness": [40.0, 41.0, 50.0, 51.0],
        "joint_damping": [1.5, 1.6, 2.0, 2.1],
        "default_joint_pos": DEFAULT,
        "observation": terms(),
        "command_names": ("twist",),
        "action_scale": SCALE,
        "policy_dt": DT,
        "body_names": (),
        "command_ranges": [[-1.0, 1.0], [-0.5, 0.5], [-1.0, 1.0]],
        "phase": PhaseRule(PERIOD),
    }
    return PolicyContract(**{**values, **changes})


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


def save_checkpoint(path: Path, wiring: PolicyContract | None = None, *, complete: bool = True) -> Path:
    """Export the policy; complete: with all that the thirteen keys cannot say."""
    wiring = contract() if wiring is None else wiring
    metadata = write_metadata(wiring)
    if complete:
        metadata[STAMP_KEY] = encode(wiring)
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["obs", "weights"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, WIDTH])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, len(DRIVEN)])],
        [numpy_helper.from_array(network(), "weights")],
    )
    onnx.save(finished(graph, metadata), str(path))
    return path


@dataclass
class Run:
    """A run, F steps; every array has one row per step."""

    steps: int = 30
    qpos: np.ndarray = field(init=False)
    qvel: np.ndarray = field(init=False)
    obs: np.ndarray = field(init=False)
    action: np.ndarray = field(init=False)
    target: np.ndarray = field(init=False)
    cmd: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(11)
        time = DT * np.arange(self.steps)[:, None]
        places = np.array([ROBOT_JOINTS.index(name) for name in JOINTS])
        q = np.empty((self.steps, 4))
        q[:, places] = DEFAULT + 0.3 * np.sin(6.0 * time + np.arange(4))
        qd = np.empty_like(q)
        qd[:, places] = 1.8 * np.cos(6.0 * time + np.arange(4))
        quaternion = np.array([0.6, 0.05, -0.1, 0.7]) + 0.05 * rng.normal(size=(self.steps, 4))
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        position = np.array([0.3, -0.2, 0.8]) + 0.01 * time
        self.qpos = np.concatenate([position, quaternion, q], axis=1)
        self.qvel = np.concatenate([rng.normal(size=(self.steps, 6)), qd], axis=1)
        self.cmd = np.array([0.5, -0.1, 0.3])
        self._act(q[:, places], qd[:, places], quaternion)

    def _act(self, q: np.ndarray, qd: np.ndarray, quaternion: np.ndarray) -> None:
        last, relative = np.zeros(3, dtype=np.float32), q - DEFAULT
        observations, actions = [], []
        for k in range(self.steps):
            gravity = _rotation(quaternion[k]).T @ np.array([0.0, 0.0, -1.0])
            angles = 2.0 * np.pi * DT / PERIOD * (k + 1) + np.array([0.0, np.pi])
            past = [relative[max(k - back, 0)] for back in reversed(range(HISTORY))]
            parts = [0.25 * self.qvel[k, 3:6], gravity, self.cmd, *past, 0.05 * qd[k], last]
            observation = np.concatenate([*parts, np.sin(angles), np.cos(angles)]).astype(np.float32)
            last = observation @ network()
            observations.append(observation)
            actions.append(last)
        self.obs, self.action = np.stack(observations), np.stack(actions)
        self.target = np.zeros((self.steps, 4))
        for a, name in enumerate(DRIVEN):
            self.target[:, ROBOT_JOINTS.index(name)] = DEFAULT[JOINTS.index(name)] + SCALE[a] * self.action[:, a]

    def arrays(self) -> dict[str, np.ndarray]:
        """What the trainer writes into a trace."""
        return {
            "qpos": self.qpos,
            "qvel": self.qvel,
            "obs": self.obs,
            "action": self.action,
            "cmd": self.cmd,
            "target": self.target,
            "joint_names": np.array(["root", *ROBOT_JOINTS]),
        }


def save_trace(path: Path, run: Run, **changes: np.ndarray | None) -> Path:
    """Write a run; a change of None leaves the array out."""
    arrays = {**run.arrays(), **changes}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
