"""`contract_findings`: what is wrong with a contract for a robot, in one line a finding, with the joints named."""

from dataclasses import replace

import msgspec
import pytest
from models import contract_of
from policy_fixtures import found
from trainer import JOINTS, contract

from humanoid_sim.policy.checks import contract_findings, suspicious_findings
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.robots.schema import BaseSettings

SUFFIXED = tuple(f"{name}_joint" for name in JOINTS)
HIPS, KNEES = ("left_hip", "right_hip"), ("left_knee", "right_knee")
SOUND = {
    "joint_stiffness": [40.0, 40.0, 50.0, 50.0],
    "joint_damping": [1.5, 1.5, 2.0, 2.0],
    "default_joint_pos": [-0.2, -0.2, 0.6, 0.6],
    "action_scale": [0.25, 0.35, 0.35],
    "effort_limit": 60.0,
}
TRACKING = {"task_type": "tracking", "command_names": ("motion",), "phase": None}


def findings_of(robot, *, hardware=False, **changes):
    return contract_findings(contract(**{**SOUND, **changes}), robot, bare_model(robot), hardware=hardware)


CASES = [
    # what differs, the finding, and the joints that it names
    ({"joint_stiffness": [0.0, 40.0, 50.0, 50.0]}, "error joint_stiffness: is 0", ("left_hip",)),
    ({"joint_stiffness": 1.0}, "error joint_stiffness: placeholder", ()),
    ({"joint_damping": -0.0}, "error joint_damping: all 4 joints", ()),
    ({"joint_stiffness": [40.0, 44.0, 50.0, 50.0]}, "warning joint_stiffness: 44", ("left_hip",)),
    ({"default_joint_pos": [-0.2, -0.2, 0.6, 0.5]}, "warning default_joint_pos: 0.5", ("left_knee",)),
    ({"default_joint_pos": [-0.2, -0.2, 2.5, 2.5]}, "error default_joint_pos: range -0.1 to 2", KNEES),
    ({"default_joint_pos": [-20.0, -20.0, 0.6, 0.6]}, "error default_joint_pos: in degrees?", HIPS),
    ({"action_scale": [0.25, 0.0, 0.0]}, "error action_scale: cannot move", HIPS),
    ({"effort_limit": None}, "warning effort_limit: all 4 joints", ()),
    (
        {**TRACKING, "observation": ("command",), "body_names": ("pelvis", "left_shin")},
        "error body_names: body or site of 'walker' 'left_shin'",
        (),
    ),
    (
        {"joint_names": SUFFIXED, "action_joint_names": SUFFIXED, "action_scale": 0.3},
        "error joint_names: did you mean 'left_knee'",
        SUFFIXED,
    ),
    (
        {"joint_names": (*JOINTS[:3], "tail"), "action_joint_names": JOINTS[:1], "action_scale": 0.3},
        "error joint_names: not of 'walker'",
        ("tail",),
    ),
    ({"source": {"joint_names": "deploy.yaml and the robot"}}, "warning joint_names: any robot with as many", ()),
]


@pytest.mark.parametrize(("changes", "line", "joints"), CASES)
def test_a_mistake_is_one_line(changes, line, joints, robot):
    finding = found(findings_of(robot, **changes), line)
    assert all(joint in finding.message for joint in joints)


def test_a_model_that_no_policy_can_mean(robot):
    sideways = bare_model(robot)
    sideways.opt.gravity[:] = (0.0, -9.81, 0.0)
    fixed = msgspec.structs.replace(robot, base=BaseSettings())
    findings = contract_findings(contract(**SOUND), fixed, sideways, hardware=False)
    assert found(findings, "warning gravity: 0 -9.81 0 m/s²")
    assert found(findings, "warning base: the policy walks")


def test_damping_of_the_model_beside_the_contracts(robot):
    """Both act unless the contract decides; a joint that the model brakes is not without a brake."""
    damped = bare_model(robot)
    damped.dof_damping[6:8] = 0.5
    wiring = contract(**{**SOUND, "joint_damping": [1.5, 0.0, 2.0, 2.0]})
    kept = contract_findings(wiring, robot, damped, hardware=False)
    assert "left_hip (1.5 + 0.5)" in found(kept, "warning model_joint_damping: ").message
    assert "right_hip" in found(suspicious_findings(wiring), "warning joint_damping: nothing brakes").message
    decided = contract_findings(replace(wiring, model_joint_damping="keep"), robot, damped, hardware=False)
    assert not any(finding.field == "model_joint_damping" for finding in decided)


def test_gains_that_the_motors_cannot_encode():
    lite = load_robot("lite")
    stiffness, damping = [50.0] * 14, [2.0] * 14
    stiffness[4], damping[3] = 501.0, 6.0
    wiring = contract_of(lite.joint_names, joint_stiffness=stiffness, joint_damping=damping, observation=["joint_pos"])
    findings = contract_findings(wiring, lite, bare_model(lite), hardware=True)
    assert "left_wrist_yaw (501" in found(findings, "error joint_stiffness: ").message
    assert "6, at most 5" in found(findings, "error joint_damping: ").message


ARMATURE = {
    f"{side}_{part}": value
    for part, value in {"hip": 0.01, "knee": 0.02, "foot": 0.005}.items()
    for side in ("left", "right")
}
LINK = '<body><joint name="{0}" armature="{1}" actuatorfrcrange="-{2} {2}"/><geom size="0.1"/>'
SERVO = '<position joint="{0}" kp="{1}" kv="{2}" ACT/>'
MOTORIZED = (
    '<mujoco><worldbody><body name="base">'
    + "".join(LINK.format(name, value, 1e4 * value) for name, value in ARMATURE.items())
    + "</body>" * 7
    + "</worldbody><actuator>"
    + "".join(SERVO.format(name, 4e3 * value, 250 * value) for name, value in reversed(ARMATURE.items()))
    + "</actuator></mujoco>"
)


@pytest.fixture
def motorized(tmp_path):
    """Findings on a robot whose model has actuators, with what a contract gets wrong; gains by the motors' armature."""

    def findings(text=MOTORIZED, **changes):
        (tmp_path / "robot.xml").write_text(text.replace("ACT", ""))
        robot = load_robot(tmp_path / "robot.xml")
        values = {
            "joint_names": tuple(ARMATURE),
            "action_joint_names": tuple(ARMATURE),
            "joint_stiffness": [4e3 * value for value in ARMATURE.values()],
            "joint_damping": [250 * value for value in ARMATURE.values()],
            "default_joint_pos": 0.1,
            "action_scale": 0.625,
            "observation": ("joint_pos",),
            "phase": None,
        }
        return contract_findings(contract(**values | changes), robot, bare_model(robot), hardware=False)

    return findings


def test_gains_of_the_models_own_actuators(motorized):
    assert [finding for finding in motorized() if finding.severity == "warning"] == []
    backwards = [4e3 * value for value in reversed(ARMATURE.values())]
    found(motorized(joint_stiffness=backwards), "warning joint_stiffness: own actuators for 4 joints")
    double = motorized(joint_damping=[5.0, 5.0, 10.0, 10.0, 2.5, 2.5])
    found(double, "warning joint_damping: right_knee (10, actuator 5)")
    clipped = MOTORIZED.replace("ACT", 'ctrlrange="-1 1"')
    found(motorized(clipped), "warning position_clip: clip the targets of all 6 joints")
    assert not any(finding.field == "position_clip" for finding in motorized(clipped, position_clip="joint_limits"))


def test_a_joint_that_leaves_the_exporters_formula(motorized):
    """mjlab derives the scale from torque limit and K_p; rounded values fit."""
    varied = {"joint_stiffness": [40.0, 40.0, 50.0, 50.0, 25.0, 25.0]}
    scales = [0.25 * 1e4 * a / k for a, k in zip(ARMATURE.values(), varied["joint_stiffness"], strict=True)]
    assert not any("effort limit / K_p" in f.message for f in motorized(**varied, action_scale=scales))
    scales[2] = 0.35
    found(
        motorized(**varied, action_scale=scales),
        "warning action_scale: effort limit / K_p for 5 joints, but not for left_knee",
    )
    gains = [40.0, 40.0, 80.0, 99.0, 20.0, 20.0]
    found(
        motorized(joint_stiffness=gains), "warning joint_stiffness: armature for 5 joints, but not for right_knee (99"
    )


def test_decimals_that_an_exporter_cut(robot):
    source = {"source": dict.fromkeys(("action_scale", "joint_damping"), "mjlab metadata")}
    for scale, severity in ((0.055, "warning"), (0.001, "error")):
        findings = findings_of(robot, action_joint_names=JOINTS, action_scale=scale, **source)
        found(findings, f"{severity} rounding: action_scale was cut at 3 decimals")
