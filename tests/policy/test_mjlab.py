"""What mjlab's metadata says and implies."""

import json
from pathlib import Path

import numpy as np
import pytest

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


WRITTEN = json.loads((Path(__file__).parents[1] / "data" / "mjlab_metadata.json").read_text(encoding="utf-8"))
"""By task, of the Unitree G1."""


def contract(metadata):
    return merge([read_mjlab(metadata, "policy.onnx")], "policy.onnx")


@pytest.mark.parametrize("task", WRITTEN)
def test_what_mjlab_writes_is_all_that_a_contract_needs(task):
    made = contract(WRITTEN[task])
    assert made.task_type == ("tracking" if task.startswith("tracking") else "locomotion")
    assert (len(made.joint_names), made.joint_names[3]) == (29, "left_knee_joint")
    assert (made.joint_stiffness[3], made.joint_damping[3], made.default_joint_pos[3]) == (99.098, 6.309, 0.669)
    assert (made.action_scale[3], made.policy_dt) == (0.351, 0.02)
    assert made.observation_names == tuple(WRITTEN[task]["observation_names"].split(","))
    assert {(term.history, term.clip) for term in made.terms} == {(1, None)}
    assert {term.name: term.scale for term in made.terms if term.scale != 1.0} == (
        {"height_scan": 0.2} if task == "velocity_rough" else {}
    )
    assert made.anchor_body == ("torso_link" if made.task_type == "tracking" else "")


def test_the_velocity_of_the_base_is_the_imus_in_files_of_mjlab_1_6():
    made = contract(WRITTEN["velocity_flat"])
    assert {term.name: term.at for term in made.terms}["base_lin_vel"] == "imu"
    assert "observation term base_lin_vel: at imu: assumed (mjlab)" in assumptions(made)
    older = {key: text for key, text in WRITTEN["velocity_flat"].items() if not key.startswith("observation_terms")}
    assert {term.name: term.at for term in contract(older).terms}["base_lin_vel"] == "base"
    stated = parse_contract({"terms": {"base_lin_vel": {"at": "base"}}}, "contract.yaml", "contract.yaml")
    both = merge([read_mjlab(WRITTEN["velocity_flat"], "policy.onnx"), *stated], "policy.onnx")
    assert {term.name: term.at for term in both.terms}["base_lin_vel"] == "base"


HISTORY, FLAT = "observation_terms_history_length", "observation_terms_flatten_history_dim"
