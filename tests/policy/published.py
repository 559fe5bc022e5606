"""Where the published policies lie that some tests read: beside the checkout, or where HUMANOID_SIM_POLICIES says."""

import os
from pathlib import Path

import pytest

_BESIDE = Path(__file__).parents[3] / "shared" / "policies"
POLICIES = Path(os.environ.get("HUMANOID_SIM_POLICIES", _BESIDE))

needs_policies = pytest.mark.skipif(
    not POLICIES.is_dir(), reason=f"no published policies in {POLICIES}; set HUMANOID_SIM_POLICIES"
)

MJLAB = "mjlab_1_6_g1_velocity_flat/g1_velocity_flat.onnx", "mjlab_1_6_g1_velocity_flat/g1_velocity_flat.trace.npz"
"""What mjlab 1.6 exported, and 60 steps of its own environment."""

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
