import pytest

from humanoid_sim.ros2.topics import TOPICS, joint_states_topic


def test_what_a_late_subscriber_needs_is_latched():
    latched = {name for name, topic in TOPICS.items() if topic.latched and not name.endswith("/state")}
    assert latched == {"/safety_status", "/robot_description"}


@pytest.mark.parametrize(
    ("prefix", "topic"),
    [("g1 29-dof", "/g1_29_dof/joint_states"), ("3r", "/_3r/joint_states"), ("Ätna", "/_tna/joint_states")],
)
def test_a_prefix_becomes_a_name_that_ros_allows(prefix, topic):
    assert joint_states_topic(prefix) == topic
