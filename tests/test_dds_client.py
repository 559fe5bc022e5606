"""The client for DDS by itself; tests/frontends/dds/test_bridge.py has it at a session."""

from types import SimpleNamespace

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

from dds_bridge import free_domain
from waiting import until

from humanoid_sim.dds_client import RobotClient
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.messages import ControlMode, Mode, SafetyLevel
from humanoid_sim.mit import MITCommand
from humanoid_sim.ros2.dds.endpoints import Writer
from humanoid_sim.ros2.messages import encode_control_mode, encode_safety_status
from humanoid_sim.ros2.topics import CONTROL_MODE_TOPIC, SAFETY_TOPIC


def test_what_is_not_known_is_said_and_a_broken_subscription_is_no_silence():
    with RobotClient("three", domain=free_domain()) as robot:
        assert (robot.state(timeout=0.0), robot.joint_names, robot.description()) == (None, (), None)
        assert (robot.control_mode(), robot.imu(), robot.standby(), robot.safety()) == (None, None, None, {})
        with pytest.raises(FieldError, match=r"has shape \(3,\), expected \(0,\), one value per joint of the robot's"):
            robot.command(MITCommand.zeros(3))
        mode = Writer(robot._participant, CONTROL_MODE_TOPIC)
        safety = Writer(robot._participant, SAFETY_TOPIC)
        beyond = SimpleNamespace(level=9, source="a", flags=1 << 31, message="")
        safety.write(encode_safety_status(0, beyond))
        assert until(robot.safety)["a"].level is SafetyLevel.CRITICAL
        later = bytearray(encode_control_mode(0, ControlMode(Mode.REMOTE, "new")))
        later[4 + 8 + 5] = 7  # behind the encapsulation, the stamp and an empty frame
        mode.write(bytes(later))
        with pytest.raises(InputError, match=r"^/control_mode: 7 is not a valid Mode"):
            until(robot.control_mode)
        robot.close()
        with pytest.raises(InputError, match=r"^/control_mode: the subscription is broken \(DDS error -\d+\)"):
            robot.control_mode()


@pytest.mark.parametrize("text", ["-1", "233", "seven", "1.5", "٣"])
def test_a_domain_that_is_none_is_refused(text, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(InputError, match=rf"^ROS_DOMAIN_ID: is '{text}', expected a whole number from 0 to 232$"):
        RobotClient("lite")
