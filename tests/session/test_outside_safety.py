"""Safety statuses of other programs: by themselves, and through the intake of a session."""

import json

import pytest

from humanoid_sim.errors import FieldError
from humanoid_sim.messages import SafetyLevel, SafetyStatus
from humanoid_sim.session.outside_safety import OutsideSafety

OWN = (SafetyStatus(source="can0"),)


def said(source, level, stamp=0, message=""):
    return json.dumps({"source": source, "level": level, "flags": 4, "stamp": stamp, "message": message})


def levels(outside, own=OWN):
    found = outside(own)
    assert found[: len(own)] == own, "the robot's own come first, as they are"
    return {status.source: int(status.level) for status in found}


def test_each_source_stands_under_its_own_name_until_it_reports_again():
    outside = OutsideSafety()
    outside.report(said("lidar", 0))
    assert outside(OWN) is OWN, "one that was always OK leaves no trace"
    outside.report(said("lidar", 2, message="blind"))
    outside.report(said("fence", 1))
    assert levels(outside) == {"can0": 0, "lidar": 2, "fence": 1}
    assert outside(OWN)[1] == SafetyStatus(SafetyLevel.FAULT, 4, "lidar", "blind")
    outside.report(said("fence", 0))
    assert levels(outside) == {"can0": 0, "lidar": 2, "fence": 0}
    outside.report(said("lidar", 0))
    assert levels(outside) == {"can0": 0, "lidar": 0, "fence": 0}


def test_an_unknown_level_is_as_bad_as_any_and_a_flood_of_sources_still_damps():
    outside = OutsideSafety()
    outside.report(said("later version", 200))
    assert levels(outside)["later version"] == 3
    for number in range(100):
        outside.report(said(f"source {number}", 1))
    outside.report(said("the last one", 2))
    outside.report(said("the last one", 0))
    found = levels(outside)
    assert len(found) == 34
    assert found["further sources"] == 2


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "not JSON"),
        ("[" * 5000, "not JSON: "),
        ("3", "is '3', expected level, source"),
        ('{"source": "a"}', "message: is None, expected str"),
        ('{"source": 3, "message": "", "level": 1, "flags": 0, "stamp": 0}', "source: is 3, expected str"),
        ('{"source": "a", "message": "", "level": true, "flags": 0, "stamp": 0}', "level: is True, expected int"),
        ('{"source": "a", "message": "", "level": -1, "flags": 0, "stamp": 0}', "level: is -1, expected 0 to 3"),
        ('{"source": "a", "message": "", "level": 1, "flags": 0, "stamp": 0.5}', "stamp: is 0.5, expected int"),
    ],
)
def test_what_is_no_status_changes_nothing(text, why):
    outside = OutsideSafety()
    with pytest.raises(FieldError, match=rf"^safety status: {why}"):
        outside.report(text)
    assert outside(OWN) is OWN
