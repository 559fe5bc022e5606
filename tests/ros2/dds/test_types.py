"""Message types as Cyclone DDS sees them are those that a stranger writes out from the stack's definitions."""

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")


import stranger

from humanoid_sim.ros2.dds.endpoints import dds_topic, dds_type, idl_type
from humanoid_sim.ros2.definitions import JOINT_STATE
from humanoid_sim.ros2.topics import TOPICS, joint_states_topic

SCHEMAS = {**{name: topic.schema for name, topic in TOPICS.items()}, joint_states_topic("lite"): JOINT_STATE}


def test_names_on_dds():
    assert dds_topic("/lite/joint_states") == "rt/lite/joint_states"
    assert dds_type("humanoid_control_msgs/msg/MITCommand") == "humanoid_control_msgs::msg::dds_::MITCommand_"


@pytest.mark.parametrize("topic", SCHEMAS)
def test_each_field_is_the_strangers(topic):
    ours, theirs = idl_type(SCHEMAS[topic]), stranger.type_of(dds_topic(topic))
    assert ours.__idl_typename__ == theirs.__idl_typename__
    for one in (ours, theirs):
        one.__idl__.fill_type_data()
    # The type information of DDS-XTypes: a hash over names, types and order of all fields, and of theirs.
    assert ours.__idl__._xt_bytedata[0] == theirs.__idl__._xt_bytedata[0]
