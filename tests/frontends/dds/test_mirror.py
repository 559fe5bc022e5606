"""A robot from its topics alone."""

import re
from enum import IntEnum

import mujoco
import numpy as np
import pytest
from waiting import until

pytest.importorskip("cyclonedds", reason="needs the extra dds")

from humanoid_sim.client import Feed, running_sessions
from humanoid_sim.frontends.dds.mirror import Mirror, mirrored
from humanoid_sim.messages import ControlMode, Mode, SafetyLevel
from humanoid_sim.mit import MITState
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.urdf import body_documents
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Writer
from humanoid_sim.ros2.definitions import JOINT_STATE
from humanoid_sim.ros2.messages import (
    TransformEncoder,
    encode_control_mode,
    encode_imu,
    encode_joint_state,
    encode_string,
)
from humanoid_sim.ros2.topics import TOPICS, Topic

START = 1_700_000_000_000_000_000
POSE = (0.1, -0.2, 0.9, 0.6, 0.0, 0.8, 0.0)


class Robot:
    """What a bridge would publish."""

    def __init__(self, participant, description):
        self.names = description.joint_names
        self._urdf = body_documents(description)["urdf"]
        kinds = {**TOPICS, "/lite/joint_states": Topic(JOINT_STATE)}
        names = ("/robot_description", "/lite/joint_states", "/control_mode", "/imu/data", "/tf")
        self._writers = {name: Writer(participant, name, kinds[name]) for name in names}
        self._frames = TransformEncoder([("world", "pelvis")])

    def describe(self, urdf=""):
        self._writers["/robot_description"].write(encode_string(urdf or self._urdf))

    def state(self, value, seconds, names=()):
        time_ns = START + round(1e9 * seconds)
        n = len(names or self.names)
        full = np.full(n, value)
        turn = np.array([0.6, 0.0, 0.8, 0.0])
        state = MITState(seconds, full, 2.0 * full, 3.0 * full, np.zeros(n), turn, np.ones(3), np.zeros(3))
        self._writers["/control_mode"].write(
            encode_control_mode(time_ns, ControlMode(Mode.STANDBY, "standby_controller_a", "on its way"))
        )
        self._writers["/imu/data"].write(encode_imu(time_ns, state))
        self._writers["/tf"].write(self._frames.encode(time_ns, np.array([POSE])))
        self._writers["/lite/joint_states"].write(encode_joint_state(time_ns, names or self.names, state))


@pytest.fixture
def participant(domain):
    with Participant(domain) as joined:
        yield joined


def test_ticks_are_what_the_topics_say(participant, monkeypatch):
    description = load_robot("lite_biped")
    robot, mirror = Robot(participant, description), Mirror(participant, "lite")
    assert not mirror.is_there()
    robot.state(0.1, 0.0)
    assert not mirror.is_there()
    robot.describe()
    until(mirror.is_there)
    writer, image = mirror.begin()
    try:
        assert image.joint_names == description.joint_names
        robot.state(0.25, 1.5)
        mirror.look()
        record = writer._latest[0]
        assert record.index == 1
        state = record.input.state
        assert state.time == 1.5
        assert state.joint_position.tolist() == [0.25] * 14
        assert state.joint_velocity.tolist() == [0.5] * 14
        assert state.joint_effort.tolist() == [0.75] * 14
        assert state.imu_quaternion.tolist() == [0.6, 0.0, 0.8, 0.0]
        assert record.output.control_mode == ControlMode(Mode.STANDBY, "standby_controller_a", "on its way")
        assert not np.isfinite(record.output.command.position).any()
        assert [status.level for status in record.input.safety] == [SafetyLevel.WARNING]
        np.testing.assert_allclose(record.qpos[:7], POSE)
        assert record.qpos[7:].tolist() == [0.25] * 14
        monkeypatch.setattr("humanoid_sim.frontends.dds.mirror.Mode", IntEnum("Mode", {"ZERO_TORQUE": 0}))
        robot.state(0.3, 1.8)
        mirror.look()
        record = writer._latest[0]
        assert record.input.state.time == 1.8, "the joints are shown on"
        assert record.output.control_mode.mode is Mode.STANDBY
        assert record.output.control_mode.status_message.startswith("mode 2 is not known here, the last known one is")
        robot.state(0.5, 2.0, names=("somebody", "else"))
        mirror.look()
        assert writer._latest[0] is record
    finally:
        writer.close()


def test_its_model_stands_where_the_robot_s_does_and_is_no_session_to_others(participant, monkeypatch, runtime):
    description = load_robot("lite")
    robot = Robot(participant, description)
    robot.describe()
    robot.state(0.3, 0.0)
    monkeypatch.setattr("humanoid_sim.frontends.dds.mirror.Participant", lambda **_: _Kept(participant))
    said = []
    tries = iter(range(100))

    def ended():
        robot.state(0.3, 0.0)  # the mirror subscribes late, and these are not latched
        return next(tries) > 50

    with mirrored("lo", "lite", told=said.append, ended=ended) as found:
        assert found is not None
        attachment, _ = found
        assert re.fullmatch(r"waiting for a robot with /lite/joint_states on lo, domain \d+", said[0])
        assert running_sessions() == []
        with Feed(attachment.session) as feed:
            assert feed.joint_names == description.joint_names
        model = attachment.model()
        assert model.ngeom > 50
        data = mujoco.MjData(model)
        latest = attachment.latest()
        data.qpos[:] = latest[1].qpos
        mujoco.mj_kinematics(model, data)
        # Of the Lite's own model, all joints at 0.3 rad.
        np.testing.assert_allclose(data.body("left_hand").xpos, own_position(description), atol=1e-6)
        assert attachment.intake.remote(["a"], [0.0], [0.0], [0.0], [0.0], [0.0])  # heard by nobody
    assert not attachment.feed.session.is_running()


def own_position(description):
    from humanoid_sim.robots.mjcf import bare_model  # noqa: PLC0415 - beside its one use

    model = bare_model(description)
    data = mujoco.MjData(model)
    for name in description.joint_names:
        data.joint(name).qpos[0] = 0.3
    mujoco.mj_kinematics(model, data)
    return data.body("left_hand").xpos.copy()


class _Kept:
    """A participant that somebody else closes."""

    def __init__(self, participant):
        self._participant = participant

    def __enter__(self):
        return self._participant

    def __exit__(self, *_):
        pass


def at(body, value):
    return body.hinged_poses(np.full(len(body.hinged), value))
