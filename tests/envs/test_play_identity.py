"""A policy in the environment and the same policy in `play`: one trajectory, to the last bit."""

from pathlib import Path

import numpy as np
import pytest
from models import linear_model, saved
from play_fixtures import quick_robot
from published import POLICIES, needs_policies
from recorded_start import recorded_start

from humanoid_sim.assets import SAMPLE_POLICY, asset_path, motion_path
from humanoid_sim.controllers.base import RL_POLICY
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.envs.episode_robot import PlantState
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.messages import Intent, Mode, SessionHeader, TickInput
from humanoid_sim.play import main
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.stack import build_supervisor

BIPED_CONTRACT = asset_path("policies", "lite_biped_velocity.contract.yaml")


@pytest.fixture
def folder(tmp_path, monkeypatch, runtime):
    """An empty working folder; the sockets of `play` go there too."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def policy_ticks(path):
    ticks = open_recording(path).ticks()
    return [tick for tick in ticks if tick.output.control_mode.mode is Mode.LOCOMOTION and tick.output.policy_step]


def assert_same_trajectory(env, options, policy, ticks):
    observation, info = env.reset(options=options)
    for tick in ticks:
        step = tick.output.policy_step
        state, _ = env.robot.read()
        for name in ("joint_position", "joint_velocity", "joint_effort", "imu_quaternion", "imu_angular_velocity"):
            assert getattr(state, name).tobytes() == getattr(tick.input.state, name).tobytes(), name
        assert env.robot.qpos.tobytes() == tick.qpos.tobytes()
        assert observation.tobytes() == step.observation.tobytes()
        assert info["frame"] == step.frame
        action = policy(observation, info["frame"])
        assert action.tobytes() == step.action.tobytes()
        observation, _, _, _, info = env.step(action)
        assert "fault" not in info


@pytest.mark.parametrize("actuation", ["qfrc_applied"])
def test_the_sample_policy_from_a_recording(folder, actuation):
    robot = quick_robot(folder, "lite")
    options = ("--viewer", "none", "--record", "r.mcap", "--robot", robot, "--actuation", actuation)
    assert main([*options, "--script", "damp; load_a; wait; start_locomotion; hold 1.3; damp"]) == 0
    ticks = policy_ticks(folder / "r.mcap")
    assert len(ticks) >= 60
    env = PolicyEnv("lite_tracking", robot, "wave", actuation=actuation)
    assert_same_trajectory(
        env, recorded_start("r.mcap", env.scenario.description), load_checkpoint(SAMPLE_POLICY).policy, ticks
    )


def test_a_free_standing_robot_from_a_recording(folder):
    robot = quick_robot(folder, "lite_biped")
    weights = np.random.default_rng(0).normal(0.0, 0.02, (53, 14)).astype(np.float32)
    saved(Path("walk.onnx"), linear_model({}, matrix=weights))
    options = ("--viewer", "none", "--record", "r.mcap", "--robot", robot, "--policy", "walk.onnx")
    script = (
        "--script", "damp; load_a; wait; start_locomotion; hold 1.2; damp", "--yaw", "1", "--command", "0.3,0,0.2",
    )  # fmt: skip
    main([*options, *script, "--contract", str(BIPED_CONTRACT)])  # it may fall: nobody trained it
    ticks = policy_ticks(folder / "r.mcap")
    assert len(ticks) >= 50
    np.testing.assert_array_equal(ticks[0].output.policy_step.observation[6:9], np.float32([0.3, 0.0, 0.2]))
    policy = load_checkpoint(Path("walk.onnx"), BIPED_CONTRACT).policy
    env = PolicyEnv(BIPED_CONTRACT, robot, actuation="qfrc_applied")
    assert_same_trajectory(env, recorded_start("r.mcap", env.scenario.description), policy, ticks)
    assert np.ptp([tick.input.state.joint_position[3] for tick in ticks]) > 0.01  # it does move


@pytest.mark.soak
@needs_policies
@pytest.mark.parametrize(
    ("policy", "step", "options"),
    [
        ("beyondmimic_g1/Waltz.onnx", 0.0025, ("--yaw", "2")),
        ("unitree_g1_velocity_v0/exported/policy.onnx", 0.005, ("--command", "0.5,0,0")),
    ],
)
def test_published_policies_from_a_recording(folder, policy, step, options):
    g1, path = str(POLICIES / "models" / "unitree_g1" / "scene.xml"), POLICIES / policy
    chosen = ("--robot", g1, "--policy", str(path), "--physics-timestep", str(step), "--actuation", "affine", *options)
    script = "damp; load_a; wait; start_locomotion; hold 1; damp"
    main(["--viewer", "none", "--record", "r.mcap", "--script", script, *chosen])
    ticks = policy_ticks(folder / "r.mcap")
    assert len(ticks) >= 50
    env = PolicyEnv(path, g1, physics_timestep=step)
    assert_same_trajectory(env, recorded_start("r.mcap", env.scenario.description), env.scenario.policy, ticks)
    anchored = "anchor_pose" in ticks[0].input.state.extern
    assert anchored is path.name.startswith("Waltz")


class Taker:
    """A sink that keeps the ticks."""

    def __init__(self):
        self.ticks = []
        self.backlog = 0
        self.backlog_limit = 0

    def start(self, header): ...

    def tick(self, record):
        self.ticks.append(record)

    def event(self, event): ...

    def close(self): ...


def test_the_state_and_the_memory_of_a_running_session(folder):
    description = load_robot(quick_robot(folder, "lite"))
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    loaded = load_policy(checkpoint.contract, checkpoint.policy, read_motion(motion_path("reach")))
    robot = MujocoRobot(description, actuation="affine")
    supervisor = build_supervisor(description, robot.control_period, loaded)
    taker, settings = Taker(), LoopSettings(robot.control_period, realtime=False, simulated=True)
    header = SessionHeader("lite", robot.joints, robot.control_period, 0)
    session = Session(robot, supervisor, settings, header=header, sinks=[taker], qpos=lambda: robot.qpos)
    for intents in ((Intent.DAMP,), (Intent.LOAD_A,), *[()] * 90, (Intent.START_LOCOMOTION,), *[()] * 43):
        if intents == (Intent.START_LOCOMOTION,):
            state, _ = robot.read()
            controller = supervisor.controllers[RL_POLICY]
            assert isinstance(controller, RLPolicyController)
            begin, plant = len(taker.ticks), PlantState.of(robot)
        session.tick(intents)
    middle, later = PlantState.of(robot), session.memory.controller_memory
    assert later.held_ticks == controller.decimation  # the next tick infers
    for _ in range(41):
        session.tick(())
    ticks = [tick for tick in taker.ticks[begin:] if tick.output.policy_step]

    env = PolicyEnv("lite_tracking", description, "reach")
    memory = controller.activate(TickInput(state))
    assert_same_trajectory(env, {"state": plant, "memory": memory}, checkpoint.policy, ticks)
    assert_same_trajectory(env, {"state": middle, "memory": later}, checkpoint.policy, ticks[-11:])
