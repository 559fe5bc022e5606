"""Joints and bodies that the robot lacks, and which were meant; values that look like a slip, and those that do not."""

from findings import found
from trainer import JOINTS, contract

from humanoid_sim.controllers.terms import Term
from humanoid_sim.policy import checks
from humanoid_sim.policy.checks import suspicious_findings


def test_a_missing_suffix_is_recognised(robot):
    wiring = contract(
        joint_names=[f"{name}_joint" for name in JOINTS], action_joint_names=["left_hip_joint"], action_scale=[0.3]
    )
    findings = tuple(checks.joint_findings(wiring, robot))
    assert len(findings) == 4
    assert "has 'left_knee'" in found(findings, "error", "joint_names", "left_knee_joint").message


def test_joints_of_only_one_side(robot):
    wiring = contract(
        joint_names=("left_hip", "right_hip", "left_knee", "tail"), action_joint_names=("tail",), action_scale=0.3
    )
    findings = tuple(checks.joint_findings(wiring, robot))
    assert "is not a joint of 'walker'" in found(findings, "error", "joint_names", "tail").message
    assert "the policy does not" in found(findings, "error", "joint_names", "right_knee").message


def test_bodies_of_the_motion():
    wiring = contract(
        task_type="tracking",
        command_names=("motion",),
        body_names=("pelvis", "left_foot"),
        anchor_body="torso",
        phase=None,
        observation=("command", "motion_anchor_ori_b"),
    )
    findings = tuple(checks.body_findings(wiring, ("pelvis", "left_foot_link", "torso_link"), "g"))
    assert "has 'left_foot_link'" in found(findings, "error", "body_names").message
    assert "has 'torso_link'" in found(findings, "error", "anchor_body").message
    assert "is not among body_names" in found(findings, "warning", "anchor_body").message


OWN = {"left_hip": 0.5, "right_hip": 0.5, "left_knee": 2.0}
PAIRS = "1.5 + 0.5 for left_hip, right_hip; 3 + 2 for left_knee"


def test_damping_of_the_model_beside_the_contracts():
    wiring = contract(joint_damping=[1.5, 1.5, 3.0, 3.0])
    finding = found(checks.model_damping_findings(wiring, OWN), "warning", "model_joint_damping")
    assert str(finding) == (
        "model_joint_damping: nobody decides, so both act: the contract's K_d + the model's own damping, N·m·s/rad: "
        f"{PAIRS}; `model_joint_damping: keep` or `drop` in x.contract.yaml decides"
    )
    for decision in ("keep", "drop"):
        decided = contract(joint_damping=[1.5, 1.5, 3.0, 3.0], model_joint_damping=decision)
        assert PAIRS in found(checks.model_damping_findings(decided, OWN), "info", "model_joint_damping").message
    assert tuple(checks.model_damping_findings(wiring, {})) == ()
    assert tuple(checks.model_damping_findings(wiring, {"tail": 1.0})) == ()


def test_a_point_that_the_robot_lacks():
    terms = [Term("base_lin_vel", at="torso-imu"), Term("v", kind="base_lin_vel", at="imu"), Term("joint_pos", at="x")]
    wiring = contract(observation=terms)
    message = found(
        checks.point_findings(wiring, ["foot", "torso_imu"], [], "g"), "error", "observation term base_lin_vel"
    ).message
    assert message == "at is 'torso-imu', neither base nor imu nor a site of 'g', which has 'torso_imu'"
    (finding,) = checks.point_findings(wiring, ["foot"], [], "g")
    assert finding.message.endswith("of 'g', which has: foot")
    assert tuple(checks.point_findings(wiring, ["torso-imu"], [], "g")) == ()


def test_a_height_scan_lies_around_a_site_or_a_body_and_is_sent_on_a_robot():
    wiring = contract(observation=[Term("height_scan", at="torso_link", grid=(0.2, 0.1))])
    assert tuple(checks.point_findings(wiring, [], ["pelvis", "torso_link"], "g")) == ()
    assert tuple(checks.point_findings(wiring, ["torso_link"], ["pelvis"], "g")) == ()
    message = found(
        checks.point_findings(wiring, ["foot"], ["torso-link"], "g"), "error", "observation term height_scan"
    ).message
    assert message == "at is 'torso_link', neither base nor imu nor a site or body of 'g', which has 'torso-link'"
    assert found(checks.live_findings(wiring), "info", "observation term height_scan").message == (
        "a simulation scans 6 points; on a robot a program sends them, or it does not start"
    )


def test_suspicious_joints():
    wiring = contract(
        joint_stiffness=[0.0, 41.0, 50.0, 51.0], joint_damping=[1.5, 0.0, 30.0, 2.1], action_scale=[0.25, 0.0, -0.1]
    )
    findings = tuple(suspicious_findings(wiring))
    assert "cannot move" in found(findings, "error", "joint_stiffness", "left_hip").message
    assert "nothing brakes" in found(findings, "warning", "joint_damping", "right_hip").message
    assert "ratio of 0.6 s" in found(findings, "warning", "joint_damping", "left_knee").message
    assert found(findings, "error", "action_scale", "left_hip").value == 0.0
    assert "negative" in found(findings, "warning", "action_scale", "right_hip").message


def test_a_joint_whose_damping_stands_out():
    wiring = contract(joint_stiffness=[40.0, 40.0, 40.0, 40.0], joint_damping=[1.0, 1.0, 1.0, 15.0])
    assert (
        "the other joints' is about"
        in found(suspicious_findings(wiring), "warning", "joint_damping", "right_knee").message
    )


def test_suspicious_terms():
    wiring = contract(
        observation=[
            Term("base_ang_vel", scale=0.0),
            Term("projected_gravity", scale=-1.0),
            Term("base_lin_vel", scale=-2.0),
            Term("joint_pos", clip=(0.5, 1.0)),
            Term("joint_vel", scale=1e4),
        ]
    )
    findings = tuple(suspicious_findings(wiring))
    assert "sees zeros" in found(findings, "warning", "observation term base_ang_vel").message
    upside_down = found(findings, "warning", "observation term projected_gravity")
    assert upside_down.message == "scale is -1: gravity would be fed as (0, 0, 1) when upright; almost always wrong"
    assert found(findings, "warning", "observation term base_lin_vel").message == "has a negative scale"
    assert "does not hold 0" in found(findings, "warning", "observation term joint_pos").message
    assert "10000" in found(findings, "warning", "observation term joint_vel").message


def test_a_joint_that_the_model_brakes():
    wiring = {"joint_damping": [1.5, 0.0, 2.0, 2.1]}
    braked = tuple(suspicious_findings(contract(**wiring), own_damping={"right_hip": 0.3}))
    assert not any("nothing brakes" in finding.message for finding in braked)
    dropped = suspicious_findings(contract(**wiring, model_joint_damping="drop"), own_damping={"right_hip": 0.3})
    assert "nothing brakes" in found(dropped, "warning", "joint_damping", "right_hip").message
