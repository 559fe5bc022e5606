"""Topics are those of the original stack."""

import pytest

from humanoid_sim.ros2.topics import LIVE_INPUT, TOPICS, Topic, joint_states_topic


def test_quality_of_service_is_the_stacks():
    assert {name for name, topic in TOPICS.items() if topic.latched} == {
        "/safety_status",
        "/robot_description",
        "/tf_static",
        "/standby_controller/state",
        "/standby_controller_a/state",
        "/standby_controller_b/state",
    }
    assert TOPICS["/remote_policy_controller/command"].depth == 4
    assert Topic("std_msgs/msg/Float32MultiArray", 1) == LIVE_INPUT
    assert TOPICS["/control_mode"] == Topic("humanoid_control_msgs/msg/ControlMode", 10, False)


@pytest.mark.parametrize(
    ("prefix", "topic"),
    [
        ("lite", "/lite/joint_states"),
        ("g1 29-dof", "/g1_29_dof/joint_states"),
        ("3r", "/_3r/joint_states"),
        ("Ätna", "/_tna/joint_states"),
    ],
)
def test_a_prefix_becomes_a_name_that_ros_allows(prefix, topic):
    assert joint_states_topic(prefix) == topic
