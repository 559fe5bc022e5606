"""Where the published policies lie that some tests read: beside the checkout, or where HUMANOID_SIM_POLICIES says."""

import os
from pathlib import Path

import pytest
import yaml

_BESIDE = Path(__file__).parents[3] / "shared" / "policies"
POLICIES = Path(os.environ.get("HUMANOID_SIM_POLICIES", _BESIDE))

needs_policies = pytest.mark.skipif(
    not POLICIES.is_dir(), reason=f"no published policies in {POLICIES}; set HUMANOID_SIM_POLICIES"
)

MJLAB = "mjlab_1_6_g1_velocity_flat/g1_velocity_flat.onnx", "mjlab_1_6_g1_velocity_flat/g1_velocity_flat.trace.npz"
"""What mjlab 1.6 exported, and 60 steps of its own environment."""

G1 = POLICIES / "models" / "unitree_g1" / "scene.xml"
TRACES = {
    "unitree": ("unitree_g1_velocity_v0/exported/policy.onnx", "unitree_g1_velocity_v0/trace.npz"),
    "waltz": ("beyondmimic_g1/Waltz.onnx", "beyondmimic_g1/trace_Waltz.npz"),
    "holosoma": ("holosoma_g1_loco/ppo_g1_29dof.onnx", "holosoma_g1_loco/trace_ppo.npz"),
    "mjlab": MJLAB,
}
"""Checkpoints of the G1, and a run of each where it was trained."""

HOLOSOMA_REST = """\
# What ppo_g1_29dof.onnx does not say of itself.
default_joint_pos: [-0.312, 0, 0, 0.669, -0.363, 0,  -0.312, 0, 0, 0.669, -0.363, 0,  0, 0, 0,
                    0.2, 0.2, 0, 0.6, 0, 0, 0,  0.2, -0.2, 0, 0.6, 0, 0, 0]
observation:
  - actions
  - {name: base_ang_vel, scale: 0.25}
  - command_ang_vel
  - command_lin_vel
  - cos_phase
  - dof_pos
  - {name: dof_vel, scale: 0.05}
  - projected_gravity
  - sin_phase
action_scale: 0.25
action_clip: 100
policy_dt: 0.02
phase: {period: 1.0, offsets: [0.0, 3.141592653589793], standing_threshold: 0.01}
"""


def contract_beside(name: str, folder: Path, text: str = "") -> Path | None:
    """Write what a checkpoint of the G1 does not say of itself, and more; None where that is nothing."""
    document = (yaml.safe_load(HOLOSOMA_REST) if name == "holosoma" else {}) | (yaml.safe_load(text) or {})
    path = folder / "rest.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path if document else None
