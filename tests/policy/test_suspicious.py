"""Values that look like a slip, and those that do not."""

import pytest
from findings import found, lite_contract
from trainer import contract

from humanoid_sim.controllers.terms import Term
from humanoid_sim.policy.suspicious import suspicious_findings

SUSPICIOUS = {
    "kp 1": ({"joint_stiffness": 1.0, "joint_damping": 0.1}, "warning", "joint_stiffness", "placeholder"),
    "all equal": ({"joint_stiffness": 30.0}, "info", "joint_stiffness", "for all 4 joints"),
    "swapped": (
        {"joint_stiffness": [1.5, 1.6, 2.0, 2.1], "joint_damping": [40.0, 41.0, 50.0, 51.0]},
        "error",
        "joint_damping",
        "swapped",
    ),
    "slow": ({"policy_dt": 0.2}, "warning", "policy_dt", "unusual"),
    "rounded rate": ({"policy_dt": 0.017}, "warning", "policy_dt", "58.82"),
    "scale 1": ({"action_scale": 1.0}, "warning", "action_scale", "forgotten"),
    "zero pose": ({"default_joint_pos": 0.0}, "warning", "default_joint_pos", "0 for every joint"),
    "assumed": ({"provenance": {"policy_dt": "assumed (mjlab)"}}, "warning", "policy_dt", "assumed (mjlab)"),
}


@pytest.mark.parametrize("name", SUSPICIOUS)
def test_suspicious_values(name):
    changes, severity, field, text = SUSPICIOUS[name]
    assert text in found(suspicious_findings(contract(**changes)), severity, field).message


def test_the_sound_contract_is_not_suspicious():
    assert tuple(suspicious_findings(contract())) == ()


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


def test_three_decimals_of_an_exporter():
    rounded = {"joint_stiffness": [40.179, 99.098, 14.251, 28.501], "joint_damping": [0.051, 0.907, 1.8, 2.5]}
    sources = {"joint_stiffness": "mjlab metadata", "joint_damping": "mjlab metadata"}
    findings = tuple(suspicious_findings(contract(**rounded, provenance=sources)))
    assert "0.0035 % for left_knee" in found(findings, "info", "joint_stiffness").message
    assert "0.98 % for left_hip" in found(findings, "warning", "joint_damping").message
    by_hand = dict.fromkeys(sources, "contract.yaml")
    fields = [
        finding.field for finding in suspicious_findings(contract(**rounded, provenance=by_hand)) if not finding.joint
    ]
    assert fields == []


def test_the_robots_own_gains_are_not_suspicious(lite):
    findings = suspicious_findings(lite_contract(lite), lite)
    assert [finding for finding in findings if finding.field.startswith("joint_")] == []
    assert found(suspicious_findings(lite_contract(lite)), "info", "joint_stiffness").value == 50.0


def test_a_joint_that_the_model_brakes():
    wiring = {"joint_damping": [1.5, 0.0, 2.0, 2.1]}
    braked = tuple(suspicious_findings(contract(**wiring), own_damping={"right_hip": 0.3}))
    assert not any("nothing brakes" in finding.message for finding in braked)
    dropped = suspicious_findings(contract(**wiring, model_joint_damping="drop"), own_damping={"right_hip": 0.3})
    assert "nothing brakes" in found(dropped, "warning", "joint_damping", "right_hip").message
