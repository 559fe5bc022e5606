"""The interface package for ROS 2 users says what is on the wire; `tests/ros2_live` compiles it."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from humanoid_sim.ros2.definitions import CONTROL_MODE, MIT_COMMAND, SAFETY_STATUS, STANDBY_STATE, schema_text

PACKAGE = Path(__file__).parents[2] / "examples" / "ros2" / "humanoid_control_msgs"
SCHEMAS = (CONTROL_MODE, MIT_COMMAND, SAFETY_STATUS, STANDBY_STATE)


def statements(text):
    """Fields and constants, without comments and blank lines."""
    lines = (re.sub(r"\s*#.*", "", line).strip() for line in text.splitlines())
    return [line for line in lines if line]


@pytest.mark.parametrize("schema", SCHEMAS)
def test_each_definition_is_that_of_recordings_and_topics(schema):
    file = PACKAGE / "msg" / f"{schema.rsplit('/', 1)[1]}.msg"
    assert statements(file.read_text(encoding="utf-8")) == statements(schema_text(schema).split("=" * 80)[0])


def test_the_package_builds_all_of_them_and_no_more():
    built = re.findall(r'"(msg/\w+\.msg)"', (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8"))
    assert built == sorted(f"msg/{path.name}" for path in (PACKAGE / "msg").iterdir())
    assert len(built) == len(SCHEMAS) == 4
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert manifest.findtext("name") == "humanoid_control_msgs"
    assert manifest.findtext("member_of_group") == "rosidl_interface_packages"
