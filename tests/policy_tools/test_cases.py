"""Contracts that trainers' own tools wrote wrongly, from their issue trackers: each is found, and no healthy one is."""

import shutil

import pytest
from policy_fixtures import found
from published import POLICIES, needs_policies

from humanoid_sim.errors import InputError
from humanoid_sim.policy_tools.check import check_checkpoint
from humanoid_sim.robots.description import load_robot

CASES = POLICIES.parent / "cases"
G1, G1_23 = CASES / "_tools" / "g1_29.xml", CASES / "_tools" / "g1_23.xml"
SERVOS = CASES / "05_mjlab_exporters" / "g1_own_actuators.xml"
SCALE, WIDTH, LINEAR = "01_action_scale_differs", "02_obs_160_vs_154", "03_obs_98_base_lin_vel"
MJLAB = "05_mjlab_exporters"
WAIST = "error action_scale: waist_yaw_joint (0.548 against 0.35)"
NO_VELOCITY = "error observation term base_lin_vel: no estimator"
NO_MOTORS = "error robot: names no CAN motors"

TABLE = [
    # folder and case, the robot, hardware, and findings; there is no other error
    (f"{SCALE}/a_metadata_and_deploy", G1, False, WAIST),
    (f"{SCALE}/b_rounded_but_right", G1, False),
    (f"{SCALE}/c_env_yaml_beside", G1, False, WAIST),
    (f"{SCALE}/d_23dof_ids", G1_23, False, "warning not used: on motors 0 to 22"),
    (f"{WIDTH}/a_deploy_154", G1, False, "error observation: is 154 wide, the model's input 160: "),
    (
        *(f"{WIDTH}/b_metadata_160", G1, True, NO_VELOCITY, NO_MOTORS),
        "error observation term motion_anchor_pos_b: no estimator",
        "info observation term motion_anchor_ori_b: an orientation alone",
    ),
    (f"{LINEAR}/a_old_yaml_96", G1, False, "error observation: is 96 wide, the model's input 98"),
    (f"{LINEAR}/b_gait_phase_98", G1, False, "warning assumed (Unitree): standing_threshold 0.1"),
    (f"{LINEAR}/c_order_differs", G1, False, "error observation: the order differs at place 2: joint_pos in"),
    (f"{LINEAR}/d_exporter_3g", G1, False),
    (f"{LINEAR}/e_base_lin_vel", G1, True, NO_VELOCITY, NO_MOTORS),
    (
        *(f"{MJLAB}/a_actuator_order.onnx", SERVOS, False),
        "warning joint_stiffness: left and right",
        "warning joint_stiffness: own actuators for 26 joints",
    ),
    (f"{MJLAB}/b_metadata_903_draft.onnx", SERVOS, False, "warning not used: 'observation_terms_clip'"),
    (
        *(f"{MJLAB}/c_kp_one_kd_minus_zero.onnx", SERVOS, False),
        "error joint_stiffness: placeholder",
        "error joint_damping: nothing brakes all 29 joints",
    ),
    (
        *(f"{MJLAB}/d_three_decimals_lost.onnx", SERVOS, False, "error action_scale: is 0"),
        "error rounding: action_scale was cut at 3 decimals: off by up to 50 %",
        "error rounding: joint_damping",
    ),
    ("11_leapp_and_env_yaml/isaac", G1, False, "error contract: lacks joint_names: "),
]


@needs_policies
@pytest.mark.parametrize("row", TABLE, ids=[row[0] for row in TABLE])
def test_a_case(row):
    case, robot, hardware, *lines = row
    path = CASES / case if case.endswith(".onnx") else CASES / case / "exported" / "policy.onnx"
    findings = check_checkpoint(path, load_robot(str(robot)), hardware=hardware)
    for line in lines:
        found(findings, line)
    errors = [str(finding) for finding in findings if finding.severity == "error"]
    assert len(errors) == sum(line.startswith("error") for line in lines), errors


@needs_policies
def test_the_width_comes_first_and_what_is_missing_with_it(tmp_path):
    shutil.copytree(CASES / WIDTH / "a_deploy_154", tmp_path / "case")
    (tmp_path / "case" / "exported" / "policy.contract.yaml").unlink()
    width, missing = check_checkpoint(tmp_path / "case" / "exported" / "policy.onnx", load_robot(str(G1)))[:2]
    assert "is 154 wide, the model's input 160" in width.message
    assert "lacks anchor_body" in missing.message


@needs_policies
def test_a_leapp_bundle_is_called_that():
    with pytest.raises(InputError, match=r"is a LEAPP bundle, which G1-Velocity\.yaml beside it describes"):
        check_checkpoint(CASES / "11_leapp_and_env_yaml" / "leapp" / "G1-Velocity.onnx", load_robot(str(G1)))
