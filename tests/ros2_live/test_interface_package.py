"""The interface package for ROS 2, compiled: its types are those on the wire."""

import json
import re
import subprocess

import pytest
from interface_package import variables_of
from machines import ROS_PYTHON

from humanoid_sim.ros2.definitions import CONTROL_MODE, MIT_COMMAND, SAFETY_STATUS, STANDBY_STATE, schema_text

pytestmark = pytest.mark.ros

ASK = """
import json
from humanoid_control_msgs import msg
kinds = {name: getattr(msg, name) for name in ("ControlMode", "MITCommand", "SafetyStatus", "StandbyState")}
print(json.dumps({name: list(kind.get_fields_and_field_types().items()) for name, kind in kinds.items()}))
"""
ROS_NAMES = {"float64": "double", "bool": "boolean"}


def fields(schema):
    """Names and types of a definition, as rclpy says them."""
    found = []
    for word, array, name in re.findall(r"^([\w/]+)(\[\])? (\w+)$", schema_text(schema).split("=" * 80)[0], re.M):
        kind = ROS_NAMES.get(word, word)
        found.append([name, f"sequence<{kind}>" if array else kind])
    return found


def test_it_compiles_and_its_types_are_those_on_the_wire(interfaces):
    run = subprocess.run(
        [str(ROS_PYTHON), "-c", ASK], env=dict(variables_of(interfaces)), capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    compiled = json.loads(run.stdout)
    for schema in (CONTROL_MODE, MIT_COMMAND, SAFETY_STATUS, STANDBY_STATE):
        assert compiled[schema.rsplit("/", 1)[1]] == fields(schema)
    assert len(compiled["MITCommand"]) == 7
