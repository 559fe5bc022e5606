"""Message types as Cyclone DDS sees them are those that a stranger writes out from the stack's definitions."""

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")


import stranger

from humanoid_sim.ros2.dds.endpoints import dds_topic, idl_type
from humanoid_sim.ros2.topics import TOPICS, topic_kind


@pytest.mark.parametrize("topic", [*TOPICS, "/lite/joint_states", "/piano/key_state"])
def test_each_field_is_the_strangers(topic):
    ours, theirs = idl_type(topic_kind(topic).schema), stranger.type_of(dds_topic(topic))
    assert ours.__idl_typename__ == theirs.__idl_typename__
    for one in (ours, theirs):
        one.__idl__.fill_type_data()
    # The type information of DDS-XTypes: a hash over names, types and order of all fields, and of theirs.
    assert ours.__idl__._xt_bytedata[0] == theirs.__idl__._xt_bytedata[0]
