"""Message definitions: those of ROS 2 are ROS 2's, those of the control stack are the frozen ones."""

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from humanoid_sim.messages import EventKind, Mode, SafetyLevel
from humanoid_sim.recording.codec import INTENT_CODES
from humanoid_sim.ros2 import definitions
from humanoid_sim.ros2.definitions import schema_text

NAMES = [
    value for name, value in vars(definitions).items() if name.isupper() and isinstance(value, str) and "/msg/" in value
]


def parsed(name):
    return get_types_from_msg(schema_text(name), name)


@pytest.mark.parametrize("name", NAMES)
def test_a_definition_brings_all_it_depends_on(name):
    store = get_typestore(Stores.EMPTY)
    store.register(parsed(name))
    assert name in store.fielddefs
    store.hash_rihs01(name)  # raises for an unknown dependency


@pytest.mark.parametrize("name", [definitions.FLOAT32_MULTI_ARRAY, definitions.JOINT_STATE, definitions.IMU])
def test_standard_messages_are_those_of_ros(name):
    ours = get_typestore(Stores.EMPTY)
    ours.register(parsed(name))
    assert ours.hash_rihs01(name) == get_typestore(Stores.ROS2_HUMBLE).hash_rihs01(name)


def constants(name):
    return {constant: value for constant, _, value in parsed(name)[name][0]}


def test_constants_are_the_enums_of_this_package():
    modes = {mode.name: int(mode) for mode in Mode}
    assert constants(definitions.CONTROL_MODE) == modes
    assert constants(definitions.SAFETY_STATUS) == {level.name: int(level) for level in SafetyLevel}
    intents = {f"INTENT_{intent.name}": code for intent, code in INTENT_CODES.items()}
    assert intents == {
        "INTENT_DAMP": 0,
        "INTENT_LOAD_A": 1,
        "INTENT_LOAD_B": 2,
        "INTENT_START_LOCOMOTION": 3,
        "INTENT_START_REMOTE": 4,
        "INTENT_QUIT": 5,
    }
    assert constants(definitions.TICK) == modes | intents
    assert constants(definitions.EVENT) == {kind.name: int(kind) for kind in EventKind}
