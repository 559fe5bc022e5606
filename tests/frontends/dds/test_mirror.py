"""A robot from its topics alone."""

import threading
from enum import IntEnum

import mujoco
import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs the extra dds")

from humanoid_sim.frontends.dds.mirror import Mirror
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
from humanoid_sim.simulation.model import build_model

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


def mirrored(participant, robot):
    """The mirror of a robot that describes itself, and moves on until it is found."""
    stop = threading.Event()

    def publish():
        while not stop.wait(0.02):  # the mirror subscribes late, and joint states are not latched
            robot.state(0.1, 0.0)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        return Mirror(participant, "lite")
    finally:
        stop.set()
        thread.join()


def test_ticks_are_what_the_topics_say(participant, monkeypatch):
    description = load_robot("lite_biped")
    robot = Robot(participant, description)
    robot.describe()
    mirror = mirrored(participant, robot)
    assert mirror.header.joint_names == mirror.description.joint_names == description.joint_names
    mirror.ticks()
    robot.state(0.25, 1.5)
    (tick,) = mirror.ticks()
    record = tick.record
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
    record = mirror.ticks()[0].record
    assert record.input.state.time == 1.8, "the joints are shown on"
    assert record.output.control_mode.mode is Mode.STANDBY
    assert record.output.control_mode.status_message.startswith("mode 2 is not known here, the last known one is")
    robot.state(0.5, 2.0, names=("somebody", "else"))
    assert mirror.ticks() == []


def test_its_model_stands_where_the_robot_s_does(participant):
    description = load_robot("lite")
    robot = Robot(participant, description)
    robot.describe()
    mirror = mirrored(participant, robot)
    mirror.ticks()
    robot.state(0.3, 1.0)
    model, own = mirror.model(), build_model(description)
    assert model.ngeom > 50
    data, expected = mujoco.MjData(model), mujoco.MjData(own)
    data.qpos[:] = mirror.ticks()[0].record.qpos
    for name in description.joint_names:
        expected.joint(name).qpos[0] = 0.3
    for robot_model, robot_data in ((model, data), (own, expected)):
        mujoco.mj_kinematics(robot_model, robot_data)
    np.testing.assert_allclose(data.body("left_hand").xpos, expected.body("left_hand").xpos, atol=1e-6)
