"""A recording's header rebuilds policies with histories, phases, live inputs and anchors bit for bit."""

import models
import numpy as np

from humanoid_sim.controllers.base import RL_POLICY
from humanoid_sim.controllers.contract import PhaseRule, Term
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import ANCHOR_POSE, VELOCITY_COMMAND, Extern, MITState
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor, rebuild_supervisor, run_header

LITE = load_robot("lite")
JOINTS = LITE.joint_names
N = len(JOINTS)
PERIOD = 0.01
CONTRACT = models.contract(
    task_type="tracking",
    joint_names=JOINTS[::-1],
    action_joint_names=JOINTS[3:9],
    joint_stiffness=50.0,
    joint_damping=2.0,
    default_joint_pos=np.linspace(-0.1, 0.1, N),
    observation=[
        "motion_command",
        Term("motion_anchor_pos_b"),
        Term("motion_anchor_ori_b", layout="columns"),
        Term("base_ang_vel", scale=0.25, clip=(-1.0, 1.0), history=3),
        Term("projected_gravity", history=2, history_order="newest_first"),
        Term("velocity_commands"),
        Term("head_vel", kind="base_lin_vel", at="head", frame="world"),
        Term("dof_pos", joints=JOINTS[2:5]),
        Term("sin_phase"),
        Term("last_action", form="scaled", history=2),
    ],
    command_names=("motion",),
    action_scale=0.3,
    action_clip=2.0,
    action_limit=300.0,
    position_clip=[[-0.5, 0.5]],
    effort_limit=40.0,
    command_ranges=[[-0.3, 0.3], [-0.2, 0.2], [-1.0, 1.0]],
    phase=PhaseRule(0.7, standing_threshold=0.05, standing_value=None, standing_restarts=False),
    anchor_body="chest",
)


def motion():
    frames = np.random.default_rng(3).normal(size=(20, 2 * N + 7))
    frames[:, -4:] /= np.sqrt((frames[:, -4:] ** 2).sum(axis=1, keepdims=True))
    return Motion(frames.astype(np.float32), ("chest",), 0.02, layout="joints_bodies_w", joint_names=JOINTS)


def ticks():
    rng = np.random.default_rng(5)
    for index in range(80):
        time = index * PERIOD
        quaternion = rng.normal(size=4)
        quaternion /= np.sqrt((quaternion**2).sum())
        extern = {
            VELOCITY_COMMAND: Extern(rng.normal(size=3) if index % 20 > 5 else np.zeros(3), time, 0.5),
            "base_linear_velocity_at_head": Extern(rng.normal(size=3), time),
            ANCHOR_POSE: Extern(np.concatenate([rng.normal(size=3), quaternion]), time),
        }
        joints, gyro = rng.normal(size=(3, N)), rng.normal(size=3)
        yield TickInput(MITState(time, *joints, np.zeros(N), quaternion, gyro, [0, 0, 9.8], extern), ())


def policy(observation, frame):
    """Six numbers that depend on all that is seen."""
    return np.array([3.0 * np.tanh(observation[i::6].sum()) + 0.01 * frame for i in range(6)], dtype=np.float32)


def commands(controller):
    assert isinstance(controller, RLPolicyController)
    memory, found = None, []
    for tick in ticks():
        memory = controller.activate(tick) if memory is None else memory
        memory, command = controller.update(memory, tick)
        found.append(command.position.tobytes() + memory.policy.last_action.tobytes())
    return found


def test_a_run_is_repeated_bit_for_bit():
    """Of a policy with histories, a gait clock, live inputs and an anchor, from its recording's header alone."""
    loaded = load_policy(CONTRACT, policy, motion())
    ran = commands(build_supervisor(LITE, PERIOD, loaded).controllers[RL_POLICY])
    header = run_header(LITE, PERIOD, loaded, motion(), settings={})
    assert commands(rebuild_supervisor(header, policy).controllers[RL_POLICY]) == ran
    assert len(set(ran)) > 30
