"""`contract_findings`: what is wrong with a contract for a robot, in one line a finding, with the joints named."""

from dataclasses import replace

import pytest
from findings import found
from trainer import JOINTS, contract, terms

from humanoid_sim.controllers.contract import Term
from humanoid_sim.names import mirrored_pairs
from humanoid_sim.policy.checks import contract_findings
from humanoid_sim.policy.findings import joint_list
from humanoid_sim.policy.plausibility import suspicious_findings
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import bare_model

SUFFIXED = tuple(f"{name}_joint" for name in JOINTS)
HIPS, KNEES, ANY = ("left_hip", "right_hip"), ("left_knee", "right_knee"), None
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


def test_a_sound_contract_has_remarks_alone(robot):
    assert {finding.severity for finding in findings_of(robot)} <= {"info"}
    assert "names no CAN motors" in found(findings_of(robot), "info", "robot").message


CASES = {
    # name: what differs, severity and field, the joints, words of the message
    "no stiffness": ({"joint_stiffness": [0.0, 40.0, 50.0, 50.0]}, "error joint_stiffness", ("left_hip",), "is 0"),
    "placeholders": ({"joint_stiffness": 1.0}, "error joint_stiffness", JOINTS, "placeholder"),
    "no damping anywhere": ({"joint_damping": -0.0}, "error joint_damping", JOINTS, "all 4 joints"),
    "no damping": ({"joint_damping": [0.0, 0.0, 2.0, 2.0]}, "warning joint_damping", HIPS, "nothing brakes"),
    "swapped gains": ({"joint_damping": 70.0}, "error joint_damping", JOINTS, "swapped?"),
    "a ratio": ({"joint_damping": [1.5, 1.5, 30.0, 30.0]}, "warning joint_damping", KNEES, "0.6"),
    "left and right": ({"joint_stiffness": [40.0, 44.0, 50.0, 50.0]}, "warning joint_stiffness", ("left_hip",), "44"),
    "a pose": ({"default_joint_pos": [-0.2, -0.2, 0.6, 0.5]}, "warning default_joint_pos", ("left_knee",), "0.5"),
    "no pose": ({"default_joint_pos": 0.0}, "warning default_joint_pos", ANY, "is 0 for every joint"),
    "beyond": ({"default_joint_pos": [-0.2, -0.2, 2.5, 2.5]}, "error default_joint_pos", KNEES, "range -0.1 to 2"),
    "degrees": ({"default_joint_pos": [-20.0, -20.0, 0.6, 0.6]}, "error default_joint_pos", HIPS, "in degrees?"),
    "an offset": ({"action_offset": [0.6, 0.1, 1.9]}, "error action_offset", ("right_hip",), "1.9"),
    "no scale": ({"action_scale": [0.25, 0.0, 0.0]}, "error action_scale", HIPS, "cannot move"),
    "a negative scale": ({"action_scale": [0.25, -0.3, 0.3]}, "warning action_scale", ("left_hip",), "reversed?"),
    "a forgotten scale": ({"action_scale": 1.0}, "warning action_scale", ANY, "forgotten"),
    "a tiny scale": ({"action_scale": [0.25, 0.01, 0.01]}, "warning action_scale", HIPS, "hardly moves"),
    "a far reach": ({"action_scale": [0.25, 2.0, 2.0]}, "info action_scale", HIPS, "-2.2 to 1.8"),
    "a wide clip": ({"position_clip": [[-1.0, 3.0]] * 3}, "warning position_clip", ("right_knee", *HIPS), "wider than"),
    "no torque limit": ({"effort_limit": None}, "warning effort_limit", JOINTS, "all 4 joints"),
    "another rate": ({"policy_dt": 1.0}, "warning policy_dt", ANY, "1 Hz"),
    "a cut rate": ({"policy_dt": 0.0167}, "warning policy_dt", ANY, "rounded"),
    "a world upside down": (
        {"observation": terms(projected_gravity={"scale": -1.0})},
        "warning observation term projected_gravity",
        ANY,
        "gravity points up",
    ),
    "no term": ({"observation": [Term("base_ang_vel", scale=0.0)]}, "warning observation term base_ang_vel", ANY, "0"),
    "a factor": ({"observation": [Term("joint_vel", scale=1e4)]}, "warning observation term joint_vel", ANY, "10000"),
    "a clip": ({"observation": [Term("joint_pos", clip=(0.5, 1.0))]}, "warning observation term joint_pos", ANY, "0"),
    "a live input": ({"observation": [Term("mood", width=2)]}, "info observation term mood", ANY, "width 2"),
    "a point": ({"observation": [Term("base_lin_vel", at="x")]}, "error observation term base_lin_vel", ANY, "no site"),
    "a body": (
        {**TRACKING, "observation": ("command",), "body_names": ("pelvis", "left_shin")},
        "error body_names",
        ANY,
        "'left_shin' is no body of 'walker'",
    ),
    "an anchor": (
        {**TRACKING, "observation": ("motion_anchor_ori_b",), "body_names": ("left_thigh",), "anchor_body": "pelvis"},
        "warning anchor_body",
        ANY,
        "not among body_names",
    ),
    "missing suffix": (
        {"joint_names": SUFFIXED, "action_joint_names": SUFFIXED, "action_scale": 0.3},
        "error joint_names",
        SUFFIXED,
        "robot has left_knee",
    ),
    "a joint too many": (
        {"joint_names": (*JOINTS[:3], "tail"), "action_joint_names": JOINTS[:1], "action_scale": 0.3},
        "error joint_names",
        ("tail",),
        "not of 'walker'",
    ),
    "a joint too few": (
        {"joint_names": (*JOINTS[:3], "tail"), "action_joint_names": JOINTS[:1], "action_scale": 0.3},
        "error joint_names",
        ("right_knee",),
        "the policy lacks",
    ),
    "names by place": (
        {"source": {"joint_names": "deploy.yaml and the robot"}},
        "warning joint_names",
        ANY,
        "any robot with as many",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_mistake_is_one_line(name, robot):
    changes, where, joints, words = CASES[name]
    severity, _, field = where.partition(" ")
    finding = found(findings_of(robot, **changes), severity, field, words)
    if joints is not ANY:
        assert finding.joints == joints


def test_damping_of_the_model_beside_the_contracts(robot):
    """Both act unless the contract decides; a joint that the model brakes is not without a brake."""
    damped = bare_model(robot)
    damped.dof_damping[6:8] = 0.5
    wiring = contract(**{**SOUND, "joint_damping": [1.5, 0.0, 2.0, 2.0]})
    kept = contract_findings(wiring, robot, damped, hardware=False)
    assert "1.5 + 0.5 for left_hip" in found(kept, "warning", "model_joint_damping", "nobody decides").message
    assert "right_hip" in found(suspicious_findings(wiring), "warning", "joint_damping", "nothing brakes").joints
    for decision in ("keep", "drop"):
        decided = contract_findings(replace(wiring, model_joint_damping=decision), robot, damped, hardware=False)
        found(decided, "info", "model_joint_damping", f"{decision}: ")


@pytest.mark.parametrize(
    ("term", "severity"),
    [("base_lin_vel", "error"), ("motion_anchor_pos_b", "error"), ("motion_anchor_ori_b", "info")],
)
def test_hardware_has_no_estimator(robot, term, severity):
    """An orientation follows from the IMU and the joints; a velocity or a position does not."""
    wiring = {**TRACKING, "observation": (term,), "anchor_body": "pelvis", "body_names": ("pelvis",)}
    found(findings_of(robot, hardware=True, **wiring), severity, f"observation term {term}")


def test_hardware_needs_motors_and_a_rate(robot):
    findings = findings_of(robot, hardware=True, policy_dt=0.03)
    found(findings, "error", "robot", "names no CAN motors")
    found(findings, "warning", "policy_dt", "no multiple of the robot's control period")


def test_gains_that_the_motors_cannot_encode():
    lite = load_robot("lite")
    names = lite.joint_names
    stiffness, damping = [50.0] * 14, [2.0] * 14
    stiffness[4], damping[3], damping[6] = 501.0, 6.0, 0.001
    wiring = contract(
        joint_names=names,
        action_joint_names=names,
        joint_stiffness=stiffness,
        joint_damping=damping,
        default_joint_pos=0.0,
        action_scale=0.1,
        observation=("joint_pos",),
    )
    findings = contract_findings(wiring, lite, bare_model(lite), hardware=True)
    assert found(findings, "error", "joint_stiffness", "501").joints == ("left_wrist_yaw",)
    assert "6, rs-00 at most 5" in found(findings, "error", "joint_damping").message
    assert found(findings, "warning", "joint_damping", "in steps of").joints == ("left_wrist_pitch",)


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
        }
        return contract_findings(contract(**values | changes), robot, bare_model(robot), hardware=False)

    return findings


def test_gains_of_the_models_own_actuators(motorized):
    assert [finding for finding in motorized() if finding.severity == "warning"] == []
    backwards = [4e3 * value for value in reversed(ARMATURE.values())]
    order = found(motorized(joint_stiffness=backwards), "warning", "joint_stiffness", "own actuators")
    assert order.message.endswith("they stand in the order of its actuators")
    shuffled = motorized(joint_stiffness=[40.0, 20.0, 80.0, 40.0, 80.0, 20.0])
    assert "in another order" in found(shuffled, "warning", "joint_stiffness", "own act").message
    double = motorized(joint_damping=[5.0, 5.0, 10.0, 10.0, 2.5, 2.5])
    assert "right_knee (10, actuator 5)" in found(double, "warning", "joint_damping", "own actuators").message
    clipped = MOTORIZED.replace("ACT", 'ctrlrange="-1 1"')
    assert "clip the targets of all 6 joints" in found(motorized(clipped), "warning", "position_clip").message
    assert not any(finding.field == "position_clip" for finding in motorized(clipped, position_clip="joint_limits"))


def test_a_joint_that_leaves_the_exporters_formula(motorized):
    """mjlab derives K_p and K_d from the armature, the scale from torque limit and K_p; rounded values fit."""
    for field, values, joint in (
        ("joint_stiffness", [40.0, 40.0, 80.0, 80.0, 20.0, 30.0], "right_foot"),
        ("joint_damping", [2.5, 2.5, 4.0, 5.0, 1.2, 1.3], "left_knee"),
    ):
        assert found(motorized(**{field: values}), "warning", field, "armature").joints == (joint,)
    varied = {"joint_stiffness": [40.0, 40.0, 50.0, 50.0, 25.0, 25.0]}
    scales = [0.25 * 1e4 * a / k for a, k in zip(ARMATURE.values(), varied["joint_stiffness"], strict=True)]
    assert not any("effort limit / K_p" in f.message for f in motorized(**varied, action_scale=scales))
    scales[2] = 0.35
    assert found(motorized(**varied, action_scale=scales), "warning", "action_scale", "K_p").joints == ("left_knee",)


def test_decimals_that_an_exporter_cut(robot):
    source = {"source": dict.fromkeys(("action_scale", "joint_damping"), "mjlab metadata")}
    fine = {"joint_names": (*JOINTS,), "action_joint_names": JOINTS}
    for scale, severity in ((0.3485, "info"), (0.0548, "warning"), (0.0012, "error")):
        found(
            findings_of(robot, **fine, **source, action_scale=[round(scale, 3)] * 4), severity, "rounding", "3 decimals"
        )


def test_assumptions_of_a_dialect_are_one_line(robot):
    assumed = dict.fromkeys(("policy_dt", "reference_quaternion"), "assumed (mjlab)")
    message = found(findings_of(robot, source=assumed), "warning", "assumed (mjlab)").message
    assert "policy_dt 0.02 s (50 Hz); reference_quaternion wxyz" in message


def test_many_joints_are_counted():
    names = [f"joint_{i}" for i in range(29)]
    assert joint_list(names, 29) == "all 29 joints"
    assert joint_list(names[:15], 29) == "joint_0, joint_1, joint_2 and 12 more"
    assert joint_list({"knee": "2.5"}) == "knee (2.5)"


@pytest.mark.parametrize(
    "pair", [("left_knee", "right_knee"), ("LL_HR", "LR_HR"), ("l_hip_roll", "r_hip_roll"), ("hip_l", "hip_r")]
)
def test_left_and_right_are_told_by_the_names(pair):
    assert mirrored_pairs([*pair, "roll", "waist"]) == [pair]
