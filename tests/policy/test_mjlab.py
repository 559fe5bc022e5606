"""What mjlab's metadata says and implies."""

from __future__ import annotations

import numpy as np

from humanoid_sim.controllers.policy_step import advance_phase
from humanoid_sim.policy.readers.contract_yaml import parse_contract
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.mjlab import read_mjlab

WALKER = {
    "joint_names": "hip,knee",
    "joint_stiffness": "40.000,40.000",
    "joint_damping": "2.000,2.000",
    "default_joint_pos": "0.100,0.200",
    "action_scale": "0.500,0.500",
    "command_names": "twist",
    "observation_names": "base_ang_vel,command,phase,actions",
}


def test_the_term_phase_implies_its_clock() -> None:
    stated = parse_contract({"phase": {"period": 0.6}}, "contract.yaml", "contract.yaml")
    contract = merge([read_mjlab(WALKER, "policy.onnx"), *stated], "policy.onnx")
    assert contract.terms[2].kind == "gait_phase"
    rule = contract.phase
    assert rule is not None
    assert (rule.offsets.tolist(), rule.standing_threshold, rule.standing_value) == ([0.0], 0.1, None)
    assert contract.provenance["phase.standing_value"] == "assumed (mjlab)"
    # In training the first observation shows the clock at its start, and the clock runs on while the robot stands.
    walked, shown = 0.0, []
    for speed in (0.5, 0.0, 0.5):
        walked, phase = advance_phase(rule, walked, np.array([speed, 0.0, 0.0]), 0.02)
        shown.append(float(phase[0]))
    np.testing.assert_allclose(shown, [0.0, np.nan, 2 * 2 * np.pi * 0.02 / 0.6])
