"""Safety statuses of other programs: by themselves, and through the intake of a session."""

import json

import pytest
from local_session import LocalSession

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.messages import Intent, Mode, SafetyLevel, SafetyStatus
from humanoid_sim.session.outside_safety import OutsideSafety, parse_watchdogs

OWN = (SafetyStatus(source="can0"),)


class Clock:
    """ns; tests set `now`."""

    now = 1_000_000_000

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


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


def test_the_robots_own_status_is_not_taken_away_by_an_ok_of_its_name():
    outside, faulty = OutsideSafety(), (SafetyStatus(SafetyLevel.FAULT, source="can0"),)
    outside.report(said("can0", 2))
    outside.report(said("can0", 0))
    assert levels(outside, faulty) == {"can0": 2, "can0 (outside)": 0}


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


def test_names_and_messages_are_one_bounded_line():
    outside = OutsideSafety()
    outside.report(said(" a\nb\x1b[31m" + "x" * 200, 2, message="c\n" * 400))
    status = outside(())[0]
    assert status.source == ("a b[31m" + "x" * 200)[:80]
    assert len(status.message) == 300
    assert "\n" not in status.message


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


def test_a_watchdog_is_a_fault_until_its_source_reports_and_whenever_it_is_silent(clock):
    outside = OutsideSafety({"lidar": 0.5}, clock=clock)
    (status,) = outside(())
    assert (status.level, status.source, status.message) == (2, "lidar", "not reported yet (--watchdog)")
    outside.report(said("lidar", 0, clock.now))
    assert levels(outside) == {"can0": 0, "lidar": 0}
    clock.now += 500_000_000
    assert levels(outside)["lidar"] == 0
    clock.now += 1
    assert outside(())[0].message == "silent for more than 0.5 s (--watchdog)"
    outside.report(said("lidar", 0, clock.now - 600_000_000))  # it waited somewhere
    assert levels(outside)["lidar"] == 2
    outside.report(said("lidar", 0, clock.now + 10**12))  # the future buys no time
    assert levels(outside)["lidar"] == 0
    clock.now += 500_000_001
    assert levels(outside)["lidar"] == 2


def test_a_watched_source_s_own_fault_is_told_in_its_words(clock):
    outside = OutsideSafety({"lidar": 0.5}, clock=clock)
    outside.report(said("lidar", 1, clock.now, "dirty"))
    clock.now += 10**10
    assert outside(())[0] == SafetyStatus(SafetyLevel.WARNING, 4, "lidar", "dirty")


@pytest.mark.parametrize("text", ["lidar", "lidar:", ":1", "lidar:0", "lidar:nan", "lidar:1e9", f"{'x' * 81}:1"])
def test_a_watchdog_that_is_none_is_one_line(text):
    with pytest.raises(InputError, match=rf"^--watchdog: is '{text}', expected NAME:SECONDS with 0.02 to 3600 s"):
        parse_watchdogs([text])
    with pytest.raises(InputError, match=r"^--watchdog: 'a' is given twice"):
        parse_watchdogs(["a:1", "a:2"])
    assert dict(parse_watchdogs(["lidar:0.5", "door: left:2"])) == {"lidar": 0.5, "door: left": 2.0}
    assert dict(parse_watchdogs([])) == {}


@pytest.mark.parametrize("level", [1, 2, 3])
def test_any_level_but_ok_damps_in_the_next_tick_and_nothing_recovers_by_itself(local, level):
    local.enter_remote()
    monitor = local.intake("monitor")
    token = monitor.post_safety("lidar", level, "blind", flags=1)
    record = local.tick()
    assert record.output.control_mode.mode is Mode.DAMPING
    assert record.output.control_mode.status_message == f"safety {SafetyLevel(level).name} BUS_OFF from lidar: blind"
    answer = monitor.answer(token, 1.0)
    assert (answer.granted, answer.text) == (True, f"lidar is {SafetyLevel(level).name}: the robot is damped")
    assert local.tick(Intent.LOAD_A).output.refusals != ()
    monitor.post_safety("door", 0)
    assert local.tick(Intent.LOAD_A).output.refusals != (), "another source's OK clears nothing"
    monitor.post_safety("lidar", 0)
    assert local.tick().output.control_mode.mode is Mode.DAMPING
    assert local.tick(Intent.LOAD_A).output.control_mode.mode is Mode.STANDBY


def test_a_status_that_is_none_is_refused_and_recorded(local):
    monitor = local.intake("monitor")
    token = monitor._post('safety {"level": 2}')
    local.tick()
    answer = monitor.answer(token, 1.0)
    assert (answer.granted, answer.text) == (False, "safety status: source: is None, expected str")
    assert any(text.endswith(answer.text) and text.startswith("monitor (") for text in local.told)


def test_a_fault_of_the_longest_text_arrives(local):
    local.enter_remote()
    local.intake("monitor").post_safety("é" * 200, 2, '"\x01' * 300)
    assert local.tick().output.control_mode.mode is Mode.DAMPING


def test_a_silent_watchdog_keeps_the_robot_damped(local_watched):
    local = local_watched
    assert local.tick(Intent.DAMP).output.control_mode.mode is Mode.DAMPING
    assert local.tick(Intent.LOAD_A).output.refusals == (
        "LOAD_A refused: safety FAULT from lidar: not reported yet (--watchdog)",
    )
    monitor = local.intake("monitor")
    monitor.post_safety("lidar", 0)
    local.tick()
    assert local.tick(Intent.LOAD_A).output.control_mode.mode is Mode.STANDBY
    local.outside._clock = lambda: monotonic_ns() + 31_000_000_000
    assert local.tick().output.control_mode.mode is Mode.DAMPING


@pytest.fixture
def local_watched(runtime):
    local = LocalSession(watchdogs={"lidar": 30.0})
    with local.stack:
        yield local
