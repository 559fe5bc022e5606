"""A recording's links: /tf as an independent reader sees it, against MuJoCo's forward kinematics."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from recording_samples import make_tick, write_recording
from rosbags.highlevel import AnyReader

from humanoid_sim.controllers.rotation import matrix
from humanoid_sim.messages import TickInput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.recording.links import Links
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.stack import run_header


def tick_of(description, index, position, qpos):
    """A tick at 50 Hz in which the robot has these joint positions."""
    n = description.joint_count
    zeros = np.zeros(n)
    state = MITState(
        0.02 * index, position, zeros, zeros, zeros, np.array([0.8, 0.0, 0.6, 0.0]), np.zeros(3), np.zeros(3)
    )
    output = replace(
        make_tick(0).output, command=MITCommand(zeros, zeros, zeros, zeros, zeros), policy_step=None, standby=None
    )
    return TickRecord(index, TickInput(state), output, 0.001, False, qpos)


def topics(path):
    found = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    return found


def tree(message):
    """By child its parent and the transform (4, 4)."""
    found = {}
    for stamped in message.transforms:
        moved, turned = stamped.transform.translation, stamped.transform.rotation
        pose = np.eye(4)
        pose[:3, :3] = matrix(np.array([turned.w, turned.x, turned.y, turned.z]))
        pose[:3, 3] = moved.x, moved.y, moved.z
        found[stamped.child_frame_id] = stamped.header.frame_id, pose
    return found


def in_world(links, name):
    pose = np.eye(4)
    while name != "world":
        name, step = links[name]
        pose = step @ pose
    return pose


@pytest.mark.parametrize("name", ["lite", "lite_biped"])
def test_links_are_where_mujoco_has_them(name, tmp_path):
    description = load_robot(name)
    model, rng = bare_model(description), np.random.default_rng(7)
    data, ticks, expected = mujoco.MjData(model), [], []
    addresses = [int(model.joint(joint).qposadr[0]) for joint in description.joint_names]
    for index in range(3):
        if description.is_floating:
            data.qpos[:3], data.qpos[3:7] = rng.normal(size=3), rng.normal(size=4)
            data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
        data.qpos[addresses] = rng.uniform(-1.0, 1.0, len(addresses))
        mujoco.mj_kinematics(model, data)
        expected.append(data.xmat.copy().reshape(-1, 3, 3))
        ticks.append(tick_of(description, index, data.qpos[addresses].copy(), data.qpos.copy()))
    write_recording(tmp_path / "run.mcap", ticks, run_header(description, 0.02, None, settings={}))
    found = topics(tmp_path / "run.mcap")
    assert len(found["/tf"]) == 3
    assert len(found["/tf_static"]) == len(found["/robot_description"]) == 1
    assert found["/robot_description"][0].data.startswith("<robot")
    static = tree(found["/tf_static"][0])
    for i, message in enumerate(found["/tf"]):
        links = static | tree(message)
        for body in range(1, model.nbody):
            pose = in_world(links, model.body(body).name)
            assert np.abs(pose[:3, :3] - expected[i][body]).max() < 1e-6
    if description.is_floating:
        pose = found["/base_pose"][2].pose
        assert [pose.position.x, pose.position.y, pose.position.z] == data.qpos[:3].tolist()
        assert [pose.orientation.w, pose.orientation.x] == data.qpos[3:5].tolist()
    else:
        assert "/base_pose" not in found
    assert "offered_qos_profiles" not in found


def test_frames_are_sent_at_50_hz_and_the_description_once(tmp_path):
    lite = load_robot("lite")
    ticks = [tick_of(lite, index, np.zeros(14), None) for index in range(40)]
    write_recording(tmp_path / "run.mcap", ticks, run_header(lite, 0.005, None, settings={}))
    found = topics(tmp_path / "run.mcap")
    assert (len(found["/tf"]), len(found["/tf_static"]), len(found["/robot_description"])) == (10, 1, 1)


def test_without_a_simulation_the_imu_turns_the_base():
    biped = load_robot("lite_biped")
    links = Links.of(run_header(biped, 0.02, None, settings={}))
    record = tick_of(biped, 0, np.zeros(biped.joint_count), None)
    assert bare_model(biped).site(biped.imu).quat.tolist() == [1.0, 0.0, 0.0, 0.0]  # the IMU's axes are the base's
    assert links.frames[links.base][0] == "world"
    assert np.abs(links.poses(record)[links.base, 3:] - [0.8, 0.0, 0.6, 0.0]).max() < 1e-9
    assert not links.knows_base(record)
