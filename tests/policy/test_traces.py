"""Published policies on the states of a published run: each observation, term by term, and each action."""

import mujoco
import numpy as np
import pytest
from dialects import said
from published import G1, POLICIES, TRACES, contract_beside, needs_policies

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.rl_policy import RLPolicyController, RLPolicyMemory
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import ANCHOR_POSE, BASE_LINEAR_VELOCITY, VELOCITY_COMMAND, Extern, MITState, point_velocity
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import motion_bytes, parse_motion
from humanoid_sim.policy.readers.own import STAMP_KEY, encode, write_metadata
from humanoid_sim.policy.reading import read_checkpoint

pytestmark = [needs_policies, pytest.mark.usefixtures("near_ends")]

DT = 0.02


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(G1))


@pytest.fixture(scope="module")
def robot(model):
    return tuple(model.joint(index).name for index in range(1, model.njnt))


def recorded(name):
    with np.load(POLICIES / TRACES[name][1]) as trace:
        return dict(trace)


@pytest.fixture
def checkpoint(robot, tmp_path):
    """`checkpoint(name)`, with what it does not say of itself; `more` in its contract.yaml."""
    return lambda name, more="": load_checkpoint(
        POLICIES / TRACES[name][0], contract_beside(name, tmp_path, more), robot
    )


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
def test_observations_term_by_term_and_actions(name, model, robot, checkpoint):
    check = checkpoint(name)
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


@pytest.mark.parametrize("name", TRACES)
def test_a_stamp_replaces_every_side_file(name, checkpoint, tmp_path):
    check = checkpoint(name)
    alone = read_checkpoint(
        tmp_path / "copy.onnx", {STAMP_KEY: encode(check.contract), **write_metadata(check.contract)}
    ).contract
    assert said(alone) == said(check.contract)
    assert alone.source == check.contract.source


def test_a_motion_in_the_graph_can_be_kept_in_a_file(checkpoint):
    motion = checkpoint("waltz").motion
    assert motion.frames.shape == (945, 2 * 29 + 7 * 14)
    again = parse_motion(motion_bytes(motion), "motion.mcap")
    assert again.frames.tobytes() == motion.frames.tobytes()
    assert (again.joint_names, again.body_names) == (motion.joint_names, motion.body_names)
    assert (again.layout, again.policy_dt) == ("joints_bodies_w", DT)


def test_what_is_assumed_is_said(checkpoint):
    def assumed(name):
        contract = checkpoint(name).contract
        return {field for field, source in contract.source.items() if source == "assumed (mjlab)"}

    assert {"policy_dt", "reference_quaternion", "observation.actions.scale"} <= assumed("waltz")
    assert assumed("mjlab") == {"policy_dt", "observation.base_lin_vel.at"}
    assert assumed("unitree") == assumed("holosoma") == set()
