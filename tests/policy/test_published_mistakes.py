"""The deliberate mistakes that the published policies describe, written beside them: golden vectors name each."""

import json

import pytest
from published import G1, POLICIES, TRACES, contract_beside, needs_policies

from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.golden import golden_problem, trainer_samples
from humanoid_sim.policy.traces import read_trace
from humanoid_sim.policy_tools.stamp import body_reader
from humanoid_sim.robots.description import load_robot

pytestmark = [needs_policies, pytest.mark.usefixtures("near_ends")]


@pytest.fixture(scope="module")
def robot():
    return load_robot(str(G1))


@pytest.fixture(scope="module")
def loaded(robot, tmp_path_factory):
    """Each policy with golden vectors of its trace."""
    policies = {}
    for name, (model, trace) in TRACES.items():
        beside = contract_beside(name, tmp_path_factory.mktemp(name))
        checkpoint = load_checkpoint(POLICIES / model, beside, robot.joint_names)
        bodies = body_reader(robot, checkpoint.contract.anchor_body, checkpoint.contract.velocity_points)
        run = read_trace(POLICIES / trace, checkpoint.contract, bodies)
        policies[name] = checkpoint, trainer_samples(checkpoint, run)
        assert golden_problem(*policies[name]) == ""
    return policies


MISTAKES = {
    "gravity sign": ("unitree", "{terms: {projected_gravity: {scale: -1}}}", "projected_gravity"),
    "no gyro": ("unitree", "{terms: {base_ang_vel: {scale: 0}}}", "base_ang_vel"),
    "absolute joints": ("unitree", "{terms: {joint_pos_rel: {relative: false}}}", "joint_pos_rel"),
    "no joint velocity": ("unitree", "{terms: {joint_vel_rel: {scale: 0}}}", "joint_vel_rel"),
    "no last action": ("unitree", "{terms: {last_action: {scale: 0}}}", "last_action"),
    "scaled last action": ("unitree", "{terms: {last_action: {form: scaled}}}", "last_action"),
    "MJCF joint order": ("waltz", "{joint_names: ROBOT}", "joint_pos"),
    "gyro in the world": ("waltz", "{terms: {base_ang_vel: {frame: world}}}", "base_ang_vel"),
    "two rows": ("waltz", "{terms: {motion_anchor_ori_b: {layout: two_rows}}}", "motion_anchor_ori_b"),
    "column-major": ("waltz", "{terms: {motion_anchor_ori_b: {layout: columns}}}", "motion_anchor_ori_b"),
    "inverse rotation": ("waltz", "{terms: {motion_anchor_ori_b: {inverse: true}}}", "motion_anchor_ori_b"),
    "no actions": ("waltz", "{terms: {actions: {scale: 0}}}", "actions"),
    "scaled actions": ("waltz", "{terms: {actions: {form: scaled}}}", "actions"),
    "relative command": ("waltz", "{terms: {command: {relative: true}}}", "command"),
    "pelvis as anchor": ("waltz", "{anchor_body: pelvis}", "motion_anchor_pos_b"),
    "velocity in the world": ("waltz", "{terms: {base_lin_vel: {frame: world}}}", "base_lin_vel"),
    "no velocity": ("waltz", "{terms: {base_lin_vel: {scale: 0}}}", "base_lin_vel"),
    "anchor in the world": ("waltz", "{terms: {motion_anchor_pos_b: {frame: world}}}", "motion_anchor_pos_b"),
    "no anchor position": ("waltz", "{terms: {motion_anchor_pos_b: {scale: 0}}}", "motion_anchor_pos_b"),
    "velocity in the base's world": ("mjlab", "{terms: {base_lin_vel: {frame: world}}}", "base_lin_vel"),
    "mjlab's absolute joints": ("mjlab", "{terms: {joint_pos: {relative: false}}}", "joint_pos"),
    "no command": ("mjlab", "{terms: {command: {scale: 0}}}", "command"),
    "listed order": (
        "holosoma",
        "{observation: [base_ang_vel, projected_gravity, command_lin_vel, command_ang_vel, dof_pos, dof_vel, actions, "
        "sin_phase, cos_phase]}",
        "projected_gravity",
    ),
    "no scales": ("holosoma", "{terms: {base_ang_vel: {scale: 1}, dof_vel: {scale: 1}}}", "base_ang_vel"),
    "no scale of velocities": ("holosoma", "{terms: {dof_vel: {scale: 1}}}", "dof_vel"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_mistake_is_named(loaded, robot, mistake, tmp_path):
    policy, override, named = MISTAKES[mistake]
    override = override.replace("ROBOT", json.dumps(list(robot.joint_names)))
    beside = contract_beside(policy, tmp_path, f"override: {override}\n")
    wrong = load_checkpoint(POLICIES / TRACES[policy][0], beside, robot.joint_names)
    assert f": observation {named}[" in golden_problem(wrong, loaded[policy][1])
