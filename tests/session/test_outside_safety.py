"""Safety statuses of other programs: by themselves, and through the intake of a session."""

import json

import pytest

from humanoid_sim.errors import FieldError
from humanoid_sim.messages import SafetyLevel, SafetyStatus
from humanoid_sim.session.outside_safety import OutsideSafety

OWN = (SafetyStatus(source="can0"),)


def report(source, level, message=""):
    return json.dumps({"source": source, "level": level, "flags": 4, "stamp": 0, "message": message})


def levels(outside):
    found = outside(OWN)
    assert found[:1] == OWN, "the robot's own come first, as they are"
    return {status.source: int(status.level) for status in found}


def test_each_source_stands_under_its_own_name_until_it_reports_again():
    outside = OutsideSafety({})
    outside.report(report("lidar", 2, message="blind"))
    outside.report(report("fence", 1))
    assert levels(outside) == {"can0": 0, "lidar": 2, "fence": 1}
    assert outside(OWN)[1] == SafetyStatus(SafetyLevel.FAULT, 4, "lidar", "blind")
    outside.report(report("fence", 0))
    outside.report(report("later version", 200))
    assert levels(outside) == {"can0": 0, "lidar": 2, "fence": 0, "later version": 3}


@pytest.mark.parametrize(
    "text",
    [
        "",
        '{"source": "a"}',
        '{"source": "a", "message": "", "level": true, "flags": 0, "stamp": 0}',
        '{"source": "a", "message": "", "level": -1, "flags": 0, "stamp": 0}',
    ],
)
def test_what_is_no_status_changes_nothing(text):
    outside = OutsideSafety({})
    with pytest.raises(FieldError, match="safety status"):
        outside.report(text)
    assert outside(OWN) is OWN
