"""Traces: the trainer's run in a file, with what it may leave out, and what is refused."""

import numpy as np
import pytest
import trainer

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.traces import read_trace, trainer_samples
from humanoid_sim.policy_tools.stamp import body_reader

RUN = trainer.Run()
STATES = {
    **{"qpos": None, "qvel": None, "joint_names": np.array(trainer.ROBOT_JOINTS)},
    **{"joint_position": RUN.qpos[:, 7:], "joint_velocity": RUN.qvel[:, 6:]},
    **{"imu_quaternion": RUN.qpos[:, 3:7], "imu_angular_velocity": RUN.qvel[:, 3:6]},
}
"""Changes that give the states without MuJoCo's."""


@pytest.fixture
def saved(tmp_path):
    """Writes a trace of the trainer's run, with other arrays; None leaves one out."""
    return lambda **changes: trainer.save_trace(tmp_path / "t.npz", RUN, **changes)


@pytest.fixture
def samples(walker, robot):
    """Samples of a trace of the robot, every step of which was computed again."""
    checkpoint = load_checkpoint(walker)
    bodies = body_reader(robot, checkpoint.contract)
    return lambda path: trainer_samples(checkpoint, read_trace(path, checkpoint.contract, bodies))


def test_states_without_qpos(samples, saved, walker):
    assert len(samples(saved(**STATES))) == 8
    with pytest.raises(InputError, match="qpos needs the trainer's robot"):
        read_trace(saved(), load_checkpoint(walker).contract)


def test_joints_that_the_policy_lacks_are_left_out(samples, saved):
    wider = {name: np.insert(STATES[name], 2, 0.4, axis=1) for name in ("joint_position", "joint_velocity")}
    names = np.array([*trainer.ROBOT_JOINTS[:2], "waist", *trainer.ROBOT_JOINTS[2:]])
    target = np.insert(RUN.target, 2, 0.0, axis=1)
    found = samples(saved(**{**STATES, **wider, "joint_names": names, "target": target}))
    assert found.joint_names == trainer.ROBOT_JOINTS
    assert found.arrays["target"].shape == (8, 4)


def test_a_robots_model_knows_imu_and_anchor(robot, saved):
    trace = read_trace(saved(), trainer.contract(), body_reader(robot, trainer.contract(anchor_body="left_thigh")))
    state = trace.state(1)
    np.testing.assert_allclose(state.imu_angular_velocity, RUN.qvel[1, 3:6], atol=1e-12)
    np.testing.assert_allclose(state.extern["base_linear_velocity"].value, RUN.qvel[1, :3], atol=1e-12)
    position = state.extern["anchor_pose"].value[:3]
    assert np.linalg.norm(position - RUN.qpos[1, :3]) == pytest.approx(0.1)
    with pytest.raises(InputError, match="left_shin"):
        body_reader(robot, trainer.contract(anchor_body="left_shin"))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"action": None}, "has qpos, "),
        ({"joint_names": np.array(["root", "left_hip", "x", "right_hip", "y"])}, "joint_names lacks left_knee"),
        ({"qpos": None}, "joint_position is missing"),
        ({"qpos": RUN.qpos[:5]}, "qpos has shape"),
        ({"obs": np.where(RUN.obs > 0.9, np.nan, RUN.obs)}, "observation is not finite"),
        ({"cmd": None}, "velocity_command is missing"),
    ],
)
def test_broken_traces_are_one_line(saved, samples, changes, expected):
    path = saved(**changes)
    with pytest.raises(InputError, match=rf"^[^\n]*t\.npz: {expected}[^\n]*$"):
        samples(path)
