"""The client for DDS, with a bridge as a program between it and the session."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")


import rig
from dds_bridge import bridge, free_domain
from local_session import ticking
from stranger import until

from humanoid_sim.dds_client import RobotClient
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.messages import ControlMode, Mode, SafetyLevel, SafetyStatus
from humanoid_sim.mit import MITCommand
from humanoid_sim.ros2.dds.endpoints import Writer
from humanoid_sim.ros2.messages import encode_control_mode, encode_safety_status
from humanoid_sim.ros2.topics import CONTROL_MODE_TOPIC, SAFETY_TOPIC

THREE = np.ones(3)


def mode(robot):
    control = robot.control_mode()
    return control and control.mode


def test_a_client_reads_the_robot_and_commands_it(local, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(free_domain()))
    local.robot.safety = (SafetyStatus(source="can0"),)
    command = MITCommand(0.3 * THREE, 0.0 * THREE, 0.1 * THREE, 20.0 * THREE, THREE)
    with RobotClient("three") as robot, bridge():
        assert robot.state(timeout=0.0) is None
        assert (robot.control_mode(), robot.imu(), robot.standby(), robot.safety()) == (None, None, None, {})
        assert (robot.joint_names, robot.description()) == ((), None)
        with pytest.raises(FieldError, match=r"has shape \(3,\), expected \(0,\), one value per joint of the robot's"):
            robot.command(command)
        local.enter_remote()
        with ticking(local, rig.PERIOD) as records:
            state = until(lambda: robot.state(0.1), "a state")
            assert (state.names, state.position.tolist()) == (("shoulder", "elbow", "wrist"), [0.4, 0.5, 0.6])
            assert robot.joint_names == state.names
            assert robot.state(20.0).time_ns > state.time_ns
            until(lambda: mode(robot) is Mode.REMOTE, "REMOTE")
            assert until(robot.imu, "the IMU").quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
            assert until(robot.standby, "the standby state").is_finished
            assert until(robot.safety, "the safety status") == {"can0": SafetyStatus(source="can0")}
            with pytest.raises(FieldError, match=r"has shape \(2,\), expected \(3,\)"):
                robot.command(MITCommand.zeros(2))

            def obeyed():
                assert robot.command(command)
                robot.state(0.05)
                return records[-1].output.command.effort.tolist() == [0.1] * 3

            until(obeyed, "the command")


def test_what_is_not_known_is_said_and_a_broken_subscription_is_no_silence():
    with RobotClient("three", domain=free_domain()) as robot:
        mode = Writer(robot._participant, CONTROL_MODE_TOPIC)
        safety = Writer(robot._participant, SAFETY_TOPIC)
        beyond = SimpleNamespace(level=9, source="a", flags=1 << 31, message="")
        safety.write(encode_safety_status(0, beyond))
        assert until(robot.safety, "the status")["a"].level is SafetyLevel.CRITICAL
        later = bytearray(encode_control_mode(0, ControlMode(Mode.REMOTE, "new")))
        later[4 + 8 + 5] = 7  # behind the encapsulation, the stamp and an empty frame
        mode.write(bytes(later))
        with pytest.raises(InputError, match=r"^/control_mode: 7 is not a valid Mode"):
            until(robot.control_mode, "an error")
        robot.close()
        with pytest.raises(InputError, match=r"^/control_mode: the subscription is broken \(DDS error -\d+\)"):
            robot.control_mode()


@pytest.mark.parametrize("text", ["-1", "233", "seven", "1.5", "٣"])
def test_a_domain_that_is_none_is_refused(text, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(InputError, match=rf"^ROS_DOMAIN_ID: is '{text}', expected a whole number from 0 to 232$"):
        RobotClient("lite")
