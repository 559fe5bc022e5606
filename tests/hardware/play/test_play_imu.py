"""An IMU on a serial line beside emulated motors."""

import models
import mujoco
import numpy as np
import pytest

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.policy.motion import Motion, motion_bytes
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model


def saved_policy(path, inputs, **changes):
    """A policy of the Lite that holds its pose, with so many inputs."""
    lite = load_robot("lite")
    pose = lite.standby_controller_a.pose_segments[-1]
    gains = {"joint_stiffness": 50.0, "joint_damping": 2.0}
    contract = models.contract_of(lite.joint_names, default_joint_pos=pose, action_scale=1e-6, **gains, **changes)
    models.saved(path, models.linear_model(models.write_metadata(contract), inputs=inputs, outputs=14))


def test_a_policy_that_observes_one_is_refused_without(run, quick, folder, calibrate):
    saved_policy(folder / "feels.onnx", 6, observation=("projected_gravity", "imu_ang_vel"))
    calibrate()
    result = run("--robot", quick, "--hardware", "can0", "--policy", "feels.onnx", record=False)
    assert result.status == 2
    assert result.err == "error: --imu: is none, but the policy observes projected_gravity, imu_ang_vel\n"


def tracker(folder, *observation):
    """Options of `play` for a policy that holds the pose, and follows a motion of the joints and the left hand."""
    width = {"motion_anchor_ori_b": 6, "motion_anchor_pos_b": 3, "motion_command": 28}
    saved_policy(
        folder / "arm.onnx",
        sum(width[name] for name in observation),
        task_type="tracking",
        observation=observation,
        command_names=("motion",),
        body_names=("left_hand",),
        anchor_body="left_hand",
    )
    (folder / "contract.yaml").write_text("anchor_body: left_hand\n")
    frames = np.zeros((100, 2 * 14 + 7), dtype=np.float32)
    frames[:, -4] = 1.0
    motion = Motion(frames, ("left_hand",), 0.02, layout="joints_bodies_w", joint_names=load_robot("lite").joint_names)
    (folder / "arm.mcap").write_bytes(motion_bytes(motion))
    return "--policy", "arm.onnx", "--motion", "arm.mcap", "--hardware", "virtual:anchor", "--allow-script"


@pytest.mark.soak
def test_the_anchors_orientation_follows_from_imu_and_joints(run, quick, folder):
    """A tracker without state estimation runs on the real robot; one that observes a position does not."""
    walk = "hold 0.2; damp; hold 0.1; load_a; wait; start_locomotion; hold 0.3; damp"
    result = run("--robot", quick, *tracker(folder, "motion_anchor_ori_b", "motion_command"), "--script", walk)
    assert (result.status, result.err) == (0, "")
    assert "LOCOMOTION" in result.modes
    state = result.ticks[-1].input.state
    model = build_model(load_robot("lite"), scene=False)
    data = mujoco.MjData(model)
    for name, position in zip(load_robot("lite").joint_names, state.joint_position, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = position
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(state.extern["anchor_orientation"].value, data.body("left_hand").xquat, atol=1e-6)
    assert run_program(replay.main, ["r.mcap"]) == 0
    refused = run("--robot", quick, *tracker(folder, "motion_anchor_ori_b", "motion_anchor_pos_b"), record=False)
    assert refused.status == 2
    assert "motion_anchor_pos_b" in refused.err
