"""A robot from its topics alone."""

import threading
from contextlib import contextmanager

import mujoco
import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs the extra dds")

from dds_bridge import free_domain

from humanoid_sim.dds_client import RobotClient
from humanoid_sim.frontends.dds.mirror import Mirror
from humanoid_sim.messages import ControlMode, Mode, SafetyLevel
from humanoid_sim.mit import MITState
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.robots.urdf import urdf_of
from humanoid_sim.ros2.cdr import encode
from humanoid_sim.ros2.dds.endpoints import Writer
from humanoid_sim.ros2.definitions import STRING
from humanoid_sim.ros2.messages import TransformEncoder, encode_control_mode, encode_imu, encode_joint_state
from humanoid_sim.simulation.model import build_model

START = 1_700_000_000_000_000_000
POSE = (0.1, -0.2, 0.9, 0.6, 0.0, 0.8, 0.0)


class Robot:
    """What a bridge would publish."""

    def __init__(self, participant, description):
        self.names = description.joint_names
        names = ("/robot_description", "/lite/joint_states", "/control_mode", "/imu/data", "/tf")
        self._writers = {name: Writer(participant, name) for name in names}
        self._frames = TransformEncoder([("world", "pelvis")])
        self._writers["/robot_description"].write(encode(STRING, urdf_of(bare_model(description), description)))

    def state(self, value, seconds, names=()):
        time_ns, full = START + round(1e9 * seconds), np.full(len(names or self.names), value)
        imu = [0.6, 0.0, 0.8, 0.0], np.ones(3), np.zeros(3)
        state = MITState(seconds, full, 2.0 * full, 3.0 * full, 0.0 * full, *imu)
        self._writers["/control_mode"].write(
            encode_control_mode(time_ns, ControlMode(Mode.STANDBY, "standby_controller_a", "on its way"))
        )
        self._writers["/imu/data"].write(encode_imu(time_ns, state))
        self._writers["/tf"].write(self._frames.encode(time_ns, np.array([POSE])))
        measured = state.joint_position, state.joint_velocity, state.joint_effort
        self._writers["/lite/joint_states"].write(encode_joint_state(time_ns, names or self.names, *measured))


@contextmanager
def mirrored(description):
    """A robot, and its mirror: it moves on until it is found."""
    stop = threading.Event()

    def publish():
        while not stop.wait(0.02):  # the mirror subscribes late, and joint states are not latched
            robot.state(0.1, 0.0)

    with RobotClient("lite", domain=free_domain()) as client:
        robot = Robot(client._participant, description)
        thread = threading.Thread(target=publish)
        thread.start()
        try:
            mirror = Mirror(client, "lite")
        finally:
            stop.set()
            thread.join()
        mirror.ticks()
        yield robot, mirror


def test_ticks_and_model_are_what_the_topics_say():
    description = load_robot("lite_biped")
    with mirrored(description) as (robot, mirror):
        assert mirror.header.joint_names == description.joint_names
        robot.state(0.25, 1.5)
        (tick,) = mirror.ticks()
        robot.state(0.5, 2.0, names=("somebody", "else"))
        assert mirror.ticks() == []
        model, own = mirror.model(), build_model(description)
    state, output = tick.record.input.state, tick.record.output
    measured = state.joint_position, state.joint_velocity, state.joint_effort
    assert [values.tolist() for values in measured] == [[0.25] * 14, [0.5] * 14, [0.75] * 14]
    assert (state.time, state.imu_quaternion.tolist()) == (1.5, [0.6, 0.0, 0.8, 0.0])
    assert output.control_mode == ControlMode(Mode.STANDBY, "standby_controller_a", "on its way")
    assert not np.isfinite(output.command.position).any()
    assert [status.level for status in tick.record.input.safety] == [SafetyLevel.WARNING]
    np.testing.assert_allclose(tick.record.qpos, [*POSE, *[0.25] * 14])
    assert model.ngeom > 20
    data, expected = mujoco.MjData(model), mujoco.MjData(own)
    data.qpos[:] = tick.record.qpos
    expected.qpos[:7] = POSE
    for name in description.joint_names:
        expected.joint(name).qpos[0] = 0.25
    mujoco.mj_kinematics(model, data)
    mujoco.mj_kinematics(own, expected)
    np.testing.assert_allclose(data.body("left_foot").xpos, expected.body("left_foot").xpos, atol=1e-6)
