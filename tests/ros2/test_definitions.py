"""Message definitions: those of ROS 2 are ROS 2's, those of the control stack are what users of ROS 2 build."""

import re
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from humanoid_sim.messages import EventKind, Mode, SafetyLevel
from humanoid_sim.recording.codec import INTENT_CODES
from humanoid_sim.ros2 import definitions
from humanoid_sim.ros2.definitions import schema_text

PACKAGE = Path(__file__).parents[2] / "examples" / "ros2" / "humanoid_control_msgs"
BUILT = (definitions.CONTROL_MODE, definitions.MIT_COMMAND, definitions.SAFETY_STATUS, definitions.STANDBY_STATE)


def parsed(name):
    return get_types_from_msg(schema_text(name), name)


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


def statements(text):
    """Fields and constants, without comments and blank lines."""
    lines = (re.sub(r"\s*#.*", "", line).strip() for line in text.splitlines())
    return [line for line in lines if line]


def test_the_interface_package_for_users_of_ros_holds_what_is_on_the_wire():
    files = {name: PACKAGE / "msg" / f"{name.rsplit('/', 1)[1]}.msg" for name in BUILT}
    for name, file in files.items():
        assert statements(file.read_text(encoding="utf-8")) == statements(schema_text(name).split("=" * 80)[0])
    built = re.findall(r'"(msg/\w+\.msg)"', (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8"))
    assert built == sorted(f"msg/{file.name}" for file in files.values())
    assert sorted(files.values()) == sorted((PACKAGE / "msg").iterdir())
