"""A recording's links, against MuJoCo's forward kinematics of the robot's own model."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from recording_samples import write_recording
from records import record_of
from rosbags.highlevel import AnyReader

from humanoid_sim.controllers.rotation import matrix
from humanoid_sim.recording.links import Links
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.stack import run_header
from humanoid_sim.testing.healthy import healthy_state


def tick_of(position, index=0, qpos=None):
    """A tick of a robot that is pitched."""
    state = replace(healthy_state(position, 0.02 * index), imu_quaternion=[0.8, 0.0, 0.6, 0.0])
    return record_of(state, index=index, qpos=qpos)


@pytest.mark.parametrize("name", ["lite", "lite_piano", "lite_biped"])
def test_links_are_where_mujoco_has_them(name):
    description = load_robot(name)
    model, rng = bare_model(description), np.random.default_rng(7)
    data, links = mujoco.MjData(model), Links.of(run_header(description, 0.02, None, settings={}))
    addresses = [int(model.joint(joint).qposadr[0]) for joint in description.joint_names]
    if description.is_floating:
        data.qpos[:7] = rng.normal(size=7)
    data.qpos[addresses] = rng.uniform(-1.0, 1.0, len(addresses))
    mujoco.mj_normalizeQuat(model, data.qpos)
    mujoco.mj_kinematics(model, data)
    beside = np.append(data.qpos, 9.0)  # something else is simulated too
    poses = links.poses(tick_of(data.qpos[addresses], qpos=beside))
    bodies = {model.body(i).name for i in range(model.nbody)}
    assert {child for _, child in links.frames} >= bodies - {"world"}
    for (parent, child), pose in zip(links.frames, poses, strict=True):
        if {parent, child} <= bodies:
            above, below = (data.body(name).xmat.reshape(3, 3) for name in (parent, child))
            assert np.abs(matrix(pose[3:]) - above.T @ below).max() < 1e-6
    assert (links.base is not None) == description.is_floating
    if description.is_floating:
        assert np.abs(poses[links.base] - data.qpos[:7]).max() < 1e-9


def test_frames_are_sent_at_50_hz_and_the_description_once(tmp_path):
    lite, found = load_robot("lite"), {}
    ticks = [tick_of(np.zeros(14), index) for index in range(40)]
    write_recording(tmp_path / "run.mcap", ticks, run_header(lite, 0.005, None, settings={}))
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    assert (len(found["/tf"]), len(found["/robot_description"])) == (10, 1)
    assert found["/robot_description"][0].data.startswith("<robot")


def test_without_a_simulation_the_imu_turns_the_base():
    biped = load_robot("lite_biped")
    links = Links.of(run_header(biped, 0.02, None, settings={}))
    record = tick_of(np.zeros(biped.joint_count))
    assert bare_model(biped).site(biped.imu).quat.tolist() == [1.0, 0.0, 0.0, 0.0]  # the IMU's axes are the base's
    assert np.abs(links.poses(record)[links.base, 3:] - [0.8, 0.0, 0.6, 0.0]).max() < 1e-9
