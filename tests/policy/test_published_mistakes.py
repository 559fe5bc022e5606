"""The deliberate mistakes that the published policies describe: a stamped copy that is wired so is refused."""

from dataclasses import replace
from pathlib import Path

import pytest
from published import HOLOSOMA_REST, MJLAB, POLICIES, needs_policies

from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.golden.make import trainer_samples
from humanoid_sim.policy.golden.trace import read_trace
from humanoid_sim.policy.golden.verify import golden_problem
from humanoid_sim.policy_tools.stamp import body_reader
from humanoid_sim.robots.description import load_robot

pytestmark = [needs_policies, pytest.mark.usefixtures("near_ends")]

FILES = {
    "unitree": ("unitree_g1_velocity_v0/exported/policy.onnx", "unitree_g1_velocity_v0/trace.npz"),
    "waltz": ("beyondmimic_g1/Waltz.onnx", "beyondmimic_g1/trace_Waltz.npz"),
    "holosoma": ("holosoma_g1_loco/ppo_g1_29dof.onnx", "holosoma_g1_loco/trace_ppo.npz"),
    "mjlab": MJLAB,
}


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """Each policy with golden vectors of its trace."""
    rest = tmp_path_factory.mktemp("rest") / "rest.yaml"
    rest.write_text(HOLOSOMA_REST, encoding="utf-8")
    robot = load_robot(str(POLICIES / "models" / "unitree_g1" / "scene.xml"))
    policies = {}
    for name, (model, trace) in FILES.items():
        checkpoint = load_checkpoint(POLICIES / model, rest if name == "holosoma" else None, robot.joint_names)
        bodies = body_reader(robot, checkpoint.contract.anchor_body, checkpoint.contract.velocity_points)
        run = read_trace(Path(POLICIES / trace), checkpoint.contract, bodies)
        policies[name] = checkpoint, trainer_samples(checkpoint, run)
    return policies


def term(name, **options):
    """A change of one term's options."""
    return lambda wiring: {
        "observation": [replace(term, **options) if term.name == name else term for term in wiring.terms]
    }


def mjcf_order(wiring):
    """The robot's own joint order taken for the policy's."""
    names = load_robot(str(POLICIES / "models" / "unitree_g1" / "scene.xml")).joint_names
    return {"joint_names": names, "action_joint_names": names}


MISTAKES = [
    ("unitree", "gravity sign", term("projected_gravity", scale=-1.0), "projected_gravity"),
    ("unitree", "gyro zero", term("base_ang_vel", scale=0.0), "base_ang_vel"),
    ("unitree", "absolute positions", term("joint_pos_rel", relative=False), "joint_pos_rel"),
    ("unitree", "velocities zero", term("joint_vel_rel", scale=0.0), "joint_vel_rel"),
    ("unitree", "last action zero", term("last_action", scale=0.0), "last_action"),
    ("unitree", "last action scaled", term("last_action", form="scaled"), "last_action"),
    ("waltz", "MJCF joint order", mjcf_order, "command"),
    ("waltz", "gyro in world frame", term("base_ang_vel", frame="world"), "base_ang_vel"),
    ("waltz", "two rows", term("motion_anchor_ori_b", layout="two_rows"), "motion_anchor_ori_b"),
    ("waltz", "column-major", term("motion_anchor_ori_b", layout="columns"), "motion_anchor_ori_b"),
    ("waltz", "inverse rotation", term("motion_anchor_ori_b", inverse=True), "motion_anchor_ori_b"),
    ("waltz", "last action zero", term("actions", scale=0.0), "actions"),
    ("waltz", "last action scaled", term("actions", form="scaled"), "actions"),
    ("waltz", "relative command", term("command", relative=True), "command"),
    ("waltz", "pelvis as anchor", lambda _: {"anchor_body": "pelvis"}, "motion_anchor_pos_b"),
    ("waltz", "velocity in world frame", term("base_lin_vel", frame="world"), "base_lin_vel"),
    ("waltz", "velocity zero", term("base_lin_vel", scale=0.0), "base_lin_vel"),
    ("waltz", "anchor in world frame", term("motion_anchor_pos_b", frame="world"), "motion_anchor_pos_b"),
    ("waltz", "anchor zero", term("motion_anchor_pos_b", scale=0.0), "motion_anchor_pos_b"),
    ("holosoma", "scales 1", term("dof_vel", scale=1.0), "dof_vel"),
    ("holosoma", "listed order", lambda wiring: {"observation": wiring.terms[::-1]}, "sin_phase"),
    ("mjlab", "velocity in world frame", term("base_lin_vel", frame="world"), "base_lin_vel"),
    ("mjlab", "absolute positions", term("joint_pos", relative=False), "joint_pos"),
    ("mjlab", "no command", term("command", scale=0.0), "command"),
]


@pytest.mark.parametrize(("policy", "what", "change", "named"), MISTAKES, ids=[f"{m[0]}: {m[1]}" for m in MISTAKES])
def test_the_mistake_is_named(loaded, policy, what, change, named):
    checkpoint, samples = loaded[policy]
    assert golden_problem(checkpoint, samples) == ""
    wrong = replace(checkpoint, contract=replace(checkpoint.contract, **change(checkpoint.contract)))
    assert f": observation {named}[" in golden_problem(wrong, samples), what


@pytest.mark.parametrize("policy", FILES)
def test_a_forgotten_action_scale_shows_in_the_targets(loaded, policy):
    checkpoint, samples = loaded[policy]
    wrong = replace(checkpoint, contract=replace(checkpoint.contract, action_scale=1.0))
    assert "target of left_hip_pitch_joint" in golden_problem(wrong, samples)
