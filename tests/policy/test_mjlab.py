"""What mjlab's metadata says and implies."""

import numpy as np

from humanoid_sim.controllers.policy_step import advance_phase
from humanoid_sim.controllers.terms import HeightScan
from humanoid_sim.policy.contract_json import encode, read_stamp
from humanoid_sim.policy.readers.contract_yaml import parse_contract
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.mjlab import read_mjlab
from humanoid_sim.policy.readers.sources import assumptions

WALKER = {
    "joint_names": "hip,knee",
    "joint_stiffness": "40.000,40.000",
    "joint_damping": "2.000,2.000",
    "default_joint_pos": "0.100,0.200",
    "action_scale": "0.500,0.500",
    "command_names": "twist",
    "observation_names": "base_ang_vel,command,phase,actions",
}


def test_the_term_phase_implies_its_clock():
    stated = parse_contract({"phase": {"period": 0.6}}, "contract.yaml", "contract.yaml")
    contract = merge([read_mjlab(WALKER, "policy.onnx"), *stated], "policy.onnx")
    assert contract.terms[2].kind == "gait_phase"
    rule = contract.phase
    assert (rule.offsets.tolist(), rule.standing_threshold, rule.standing_value) == ([0.0], 0.1, None)
    assert contract.provenance["phase.standing_value"] == "assumed (mjlab)"
    # In training the first observation shows the clock at its start, and the clock runs on while the robot stands.
    walked, shown = 0.0, []
    for speed in (0.5, 0.0, 0.5):
        walked, phase = advance_phase(rule, walked, np.array([speed, 0.0, 0.0]), 0.02)
        shown.append(float(phase[0]))
    np.testing.assert_allclose(shown, [0.0, np.nan, 2 * 2 * np.pi * 0.02 / 0.6])


def test_a_height_scan_is_that_of_its_velocity_task():
    seeing = {**WALKER, "observation_names": "base_ang_vel,height_scan", "observation_terms_scale": "1.000,0.200"}
    contract = merge([read_mjlab(seeing, "policy.onnx")], "policy.onnx")
    assert contract.height_scan == HeightScan(
        "base", (1.6, 1.0), 0.1, "xy", offset=0.0, range=5.0, miss=None, above=0.0
    )
    assert float(contract.terms[1].scale) == 0.2
    assert contract.terms[0].grid is None
    line = (
        "observation term height_scan: at base, grid [1.6, 1], resolution 0.1, ray_order xy, offset 0, range 5, above 0"
        ": assumed (mjlab)"
    )
    assert line in assumptions(contract)
    # A stamp still says so, and another source may still say otherwise.
    for first in (read_mjlab(seeing, "policy.onnx"), read_stamp(encode(contract), "policy.onnx")):
        file = {"terms": {"height_scan": {"at": "torso", "grid": [0.8, 0.4], "miss": 2.0}}}
        stated = parse_contract(file, "contract.yaml", "contract.yaml")
        other = merge([first, *stated], "policy.onnx")
        assert other.height_scan == HeightScan("torso", (0.8, 0.4), miss=2.0)
        assert other.provenance["observation.height_scan.grid"] == "contract.yaml"
        assert other.provenance["observation.height_scan.range"] == "assumed (mjlab)"
        assert other.terms[0].at == "base"
