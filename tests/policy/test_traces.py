"""Published policies on the states of a published run: each observation, term by term, and each action."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from dialects import said
from published import HOLOSOMA_REST, MJLAB, POLICIES, needs_policies

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.rl_policy import RLPolicyController, RLPolicyMemory
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import ANCHOR_POSE, BASE_LINEAR_VELOCITY, VELOCITY_COMMAND, Extern, MITState, point_velocity
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import motion_bytes, parse_motion
from humanoid_sim.policy.readers.sources import assemble_contract, assumptions

pytestmark = [needs_policies, pytest.mark.usefixtures("near_ends")]

UNITREE = "unitree_g1_velocity_v0/exported/policy.onnx", "unitree_g1_velocity_v0/trace.npz"
WALTZ = "beyondmimic_g1/Waltz.onnx", "beyondmimic_g1/trace_Waltz.npz"
HOLOSOMA = "holosoma_g1_loco/ppo_g1_29dof.onnx", "holosoma_g1_loco/trace_ppo.npz"
TRACES = {"unitree": UNITREE, "waltz": WALTZ, "holosoma": HOLOSOMA, "mjlab": MJLAB}
DT = 0.02


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(POLICIES / "models" / "unitree_g1" / "scene.xml"))


@pytest.fixture(scope="module")
def robot(model):
    return tuple(model.joint(index).name for index in range(1, model.njnt))


@pytest.fixture(scope="module")
def contract_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("holosoma") / "contract.yaml"
    path.write_text(HOLOSOMA_REST)
    return path


def recorded(name):
    with np.load(POLICIES / TRACES[name][1]) as trace:
        return dict(trace)


def checkpoint(name, robot, contract_file):
    return load_checkpoint(POLICIES / TRACES[name][0], contract_file if name == "holosoma" else None, robot)


def states(model, trace, contract):
    """The ticks of a run from its positions and velocities: poses by forward kinematics, in the world frame."""
    data = mujoco.MjData(model)
    for index, (qpos, qvel) in enumerate(zip(trace["qpos"], trace["qvel"], strict=True)):
        time = index * DT
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        extern = {BASE_LINEAR_VELOCITY: Extern(qvel[:3], time)}
        if "cmd" in trace:
            extern[VELOCITY_COMMAND] = Extern(trace["cmd"][index] if trace["cmd"].ndim == 2 else trace["cmd"], time)
        if "imu" in contract.velocity_points:
            extern[point_velocity("imu")] = Extern(imu_velocity(model, data, qvel), time)
        if contract.anchor_body:
            body = data.body(contract.anchor_body)
            extern[ANCHOR_POSE] = Extern(np.concatenate([body.xpos, body.xquat]), time)
        zeros = np.zeros(len(qpos) - 7)
        yield TickInput(MITState(time, qpos[7:], qvel[6:], zeros, zeros, qpos[3:7], qvel[3:6], np.zeros(3), extern), ())


def imu_velocity(model, data, qvel):
    """The velocity of the IMU's site, m/s, world frame; the poses are those of the step."""
    data.qvel[:] = qvel
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    velocity = np.zeros(6)
    site = model.site("imu_in_pelvis").id
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 0)
    return velocity[3:]


def steps(loaded, robot, ticks):
    controller = RLPolicyController(robot, loaded.contract, loaded.reference, loaded.policy, DT, extern=loaded.extern)
    memory = None
    for tick in ticks:
        memory = controller.activate(tick) if memory is None else memory
        assert isinstance(memory, RLPolicyMemory), memory
        answer = controller.update(memory, tick)
        step = answer.policy_step if isinstance(answer, Fault) else answer[0].policy_step
        assert step is not None, answer
        yield step
        if isinstance(answer, Fault):  # a wrong wiring may well make the network diverge
            return
        memory = answer[0]


def loaded_policy(check):
    return load_policy(check.contract, check.policy, check.motion, check.observation_width, source=check.source)


@pytest.mark.parametrize("name", TRACES)
def test_observations_term_by_term_and_actions(name, model, robot, contract_file):
    check = checkpoint(name, robot, contract_file)
    loaded = loaded_policy(check)
    trace = recorded(name)
    count = 0
    for index, step in enumerate(steps(loaded, robot, states(model, trace, check.contract))):
        for term in loaded.layout.terms:
            np.testing.assert_allclose(
                step.observation[term.start : term.stop],
                trace["obs"][index][term.start : term.stop],
                rtol=1e-5,
                atol=1e-5,
                err_msg=f"{term.name} at step {index}",
            )
        np.testing.assert_allclose(step.action, trace["action"][index], rtol=1e-4, atol=1e-4)
        count += 1
    assert count == len(trace["obs"]) >= 60


WRONG = {
    "gravity sign": ("unitree", "{terms: {projected_gravity: {scale: -1}}}"),
    "no gyro": ("unitree", "{terms: {base_ang_vel: {scale: 0}}}"),
    "absolute joints": ("unitree", "{terms: {joint_pos_rel: {relative: false}}}"),
    "no joint velocity": ("unitree", "{terms: {joint_vel_rel: {scale: 0}}}"),
    "no last action": ("unitree", "{terms: {last_action: {scale: 0}}}"),
    "scaled last action": ("unitree", "{terms: {last_action: {form: scaled}}}"),
    "MJCF joint order": ("waltz", "{joint_names: ROBOT}"),
    "gyro in the world": ("waltz", "{terms: {base_ang_vel: {frame: world}}}"),
    "not aligned": ("waltz", "{align_reference: false}"),
    "two rows": ("waltz", "{terms: {motion_anchor_ori_b: {layout: two_rows}}}"),
    "column-major": ("waltz", "{terms: {motion_anchor_ori_b: {layout: columns}}}"),
    "inverse rotation": ("waltz", "{terms: {motion_anchor_ori_b: {inverse: true}}}"),
    "no actions": ("waltz", "{terms: {actions: {scale: 0}}}"),
    "scaled actions": ("waltz", "{terms: {actions: {form: scaled}}}"),
    "relative command": ("waltz", "{terms: {command: {relative: true}}}"),
    "action scale 1": ("waltz", "{action_scale: 1}"),
    "pelvis as anchor": ("waltz", "{anchor_body: pelvis}"),
    "velocity in the world": ("waltz", "{terms: {base_lin_vel: {frame: world}}}"),
    "no velocity": ("waltz", "{terms: {base_lin_vel: {scale: 0}}}"),
    "anchor in the world": ("waltz", "{terms: {motion_anchor_pos_b: {frame: world}}}"),
    "no anchor position": ("waltz", "{terms: {motion_anchor_pos_b: {scale: 0}}}"),
    "quaternions the other way": ("waltz", "{reference_quaternion: xyzw}"),
    "velocity in the base's world": ("mjlab", "{terms: {base_lin_vel: {frame: world}}}"),
    "command times 2": ("mjlab", "{terms: {command: {scale: 2}}}"),
    "listed order": (
        "holosoma",
        "{observation: [base_ang_vel, projected_gravity, command_lin_vel, command_ang_vel, dof_pos, dof_vel, actions, "
        "sin_phase, cos_phase]}",
    ),
    "no scales": ("holosoma", "{terms: {base_ang_vel: {scale: 1}, dof_vel: {scale: 1}}}"),
    "holosoma's action scale 1": ("holosoma", "{action_scale: 1}"),
}
SEEN_BY_THE_ROBOT_ALONE = ("action scale 1", "holosoma's action scale 1")


@pytest.mark.parametrize("mistake", WRONG)
def test_every_deliberate_mistake_can_be_written_down(mistake, model, robot, tmp_path):
    """The READMEs' wrong players as overrides: the observation differs from the trace's, or else the action."""
    name, override = WRONG[mistake]
    path = tmp_path / "contract.yaml"
    rest = HOLOSOMA_REST if name == "holosoma" else ""
    path.write_text(f"{rest}override: {override.replace('ROBOT', json.dumps(list(robot)))}\n")
    right = POLICIES / TRACES[name][0]
    check = load_checkpoint(right, path, robot)
    trace = recorded(name)
    ticks = list(states(model, trace, check.contract))
    if mistake == "not aligned":  # the trace starts where its reference does
        ticks = [turned(tick) for tick in ticks]
    seen = [
        step.observation for step, _ in zip(steps(loaded_policy(check), robot, iter(ticks)), range(50), strict=False)
    ]
    difference = np.abs(np.stack(seen) - trace["obs"][: len(seen)]).max()
    if mistake in SEEN_BY_THE_ROBOT_ALONE:
        assert difference < 1e-4
        assert check.contract.action_scale.tolist() == [1.0] * 29
    else:
        assert difference > 0.01


def turned(tick):
    """The anchor turned about the vertical by 2 rad, as if the robot stood elsewhere."""
    pose = tick.state.extern[ANCHOR_POSE].value
    half = np.array([np.cos(1.0), 0.0, 0.0, np.sin(1.0)])
    quaternion = np.empty(4)
    mujoco.mju_mulQuat(quaternion, half, pose[3:])
    extern = dict(tick.state.extern)
    extern[ANCHOR_POSE] = Extern(np.concatenate([pose[:3], quaternion]), tick.state.time)
    return replace(tick, state=replace(tick.state, extern=extern))


@pytest.mark.parametrize("name", TRACES)
def test_a_stamp_replaces_every_side_file(name, robot, contract_file, tmp_path):
    check = checkpoint(name, robot, contract_file)
    alone = assemble_contract(tmp_path / "copy.onnx", {STAMP_KEY: encode(check.contract)})
    assert said(alone) == said(check.contract)
    assert alone.provenance == check.contract.provenance


def test_a_motion_in_the_graph_can_be_kept_in_a_file(robot, contract_file):
    motion = checkpoint("waltz", robot, contract_file).motion
    assert motion.frames.shape == (945, 2 * 29 + 7 * 14)
    again = parse_motion(motion_bytes(motion), "motion.mcap")
    assert again.frames.tobytes() == motion.frames.tobytes()
    assert (again.joint_names, again.body_names) == (motion.joint_names, motion.body_names)
    assert (again.layout, again.policy_dt) == ("joints_bodies_w", DT)


def test_what_is_assumed_is_told(robot, contract_file):
    assert assumptions(checkpoint("waltz", robot, contract_file).contract) == (
        "policy_dt 0.02: assumed (mjlab)",
        "reference_quaternion wxyz: assumed (mjlab)",
        "scale of observation terms 1: assumed (mjlab)",
        "history of observation terms 1: assumed (mjlab)",
    )
    assert assumptions(checkpoint("mjlab", robot, contract_file).contract) == (
        "policy_dt 0.02: assumed (mjlab)",
        "observation term base_lin_vel: at imu: assumed (mjlab)",
    )
    assert assumptions(checkpoint("unitree", robot, contract_file).contract) == ()
    assert assumptions(checkpoint("holosoma", robot, contract_file).contract) == ()
