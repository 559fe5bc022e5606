import math
import os
import threading
import time

import numpy as np
import pytest
import rig
from local_session import LocalSession, datagram

from humanoid_sim.client import DATA_HEAD, DATA_MAGIC, Intake, SessionError, monotonic_ns
from humanoid_sim.messages import Intent, Mode

ME = f"({os.getpid()})"


def send(intake, value=0.5, **options):
    """A remote command whose positions are all `value`."""
    n = len(rig.JOINTS)
    assert intake.remote(rig.JOINTS, [value] * n, [0.0] * n, [0.0] * n, [40.0] * n, [4.0] * n, **options)


def value_of(record):
    """Of the command in force in REMOTE; None where the joints are damped."""
    command = record.output.command
    return float(command.position[0]) if command.stiffness.any() else None


def test_the_newest_command_of_a_producer_counts(local):
    intake = local.intake("gravity")
    local.enter_remote()
    for value in (0.1, 0.2, 0.3):
        send(intake, value)
    assert value_of(local.tick()) == 0.3
    assert local.data.discarded == 2
    assert local.data.owners["REMOTE"] == f"gravity {ME}"


def test_remote_belongs_to_the_first_producer_after_activation_until_it_is_stale(local):
    first, second = local.intake("first"), local.intake("second")
    send(second, 0.9)  # before REMOTE: it claims nothing
    local.enter_remote()
    assert value_of(local.tick()) is None
    for _ in range(3):
        send(first, 0.1)
        send(second, 0.2)
        assert value_of(local.tick()) == 0.1
    assert f"REMOTE: belongs to first {ME}" in local.told
    assert local.told.count(f"refused of second {ME}: REMOTE: belongs to first {ME}") == 1
    assert local.data.refusals.lines == (f"second {ME}: REMOTE: belongs to first {ME}",)
    stopped = local.time
    while local.time - stopped < 0.1 - 1.5 * rig.PERIOD:  # a sample is as old as its way was long
        send(second, 0.2)
        assert value_of(local.tick()) == 0.1
    for _ in range(2):
        send(second, 0.2)
        local.tick()
    send(second, 0.2)
    assert value_of(local.tick()) == 0.2
    assert local.told[-1] == f"REMOTE: belongs to second {ME}"


def test_a_producer_elsewhere_is_the_same_one_whichever_bridge_carries_it(local):
    bridges = [local.stack.enter_context(Intake(local.info, "dds 0110.02", process=0)) for _ in range(2)]
    local.enter_remote()
    for value, bridge in zip((0.1, 0.2, 0.3, 0.4), bridges * 2, strict=True):
        send(bridge, value)
        assert value_of(local.tick()) == value
    assert (local.data.owners["REMOTE"], local.data.refusals.count) == ("dds 0110.02", 0)


def test_a_producer_that_falls_silent_leaves_the_robot_passive_within_100_ms(local):
    intake = local.intake()
    local.enter_remote()
    for _ in range(3):
        send(intake)
        assert (value_of(local.tick()), local.data.status()["lost"]) == (0.5, {})
    sent = local.time
    while value_of(local.tick()) is not None:
        pass
    assert local.time - sent <= 0.1 + rig.PERIOD + 1e-9
    assert local.data.owners["REMOTE"] == ""
    assert local.data.status()["lost"] == {"REMOTE": f"test {ME}"}
    send(intake)
    assert value_of(local.tick()) == 0.5  # as in the original, it takes REMOTE up again
    assert local.data.status()["lost"] == {}


def test_a_new_stay_in_remote_is_a_new_turn(local):
    first, second = local.intake("first"), local.intake("second")
    local.enter_remote()
    send(first, 0.1)
    assert value_of(local.tick()) == 0.1
    local.enter_remote()
    send(second, 0.2)
    assert value_of(local.tick()) == 0.2


def test_the_earlier_of_stamp_and_receipt_counts(local):
    intake = local.intake()
    local.enter_remote()
    local.tick()
    local.tick()
    local.tick()
    send(intake, 0.5, stamp=monotonic_ns() - 30_000_000)
    record = local.tick()
    assert record.input.remote.arrival_time == pytest.approx(local.time - 0.03, abs=0.015)
    assert record.input.remote.arrival_time <= local.time - 0.03
    send(intake, 0.6)
    record = local.tick()
    assert local.time - 0.03 < record.input.remote.arrival_time <= local.time


def test_a_stamp_in_the_future_and_a_stale_one_are_refused(local):
    intake = local.intake("clock")
    local.enter_remote()
    send(intake, 0.5, stamp=monotonic_ns() + 10**9)
    assert value_of(local.tick()) is None
    assert local.told[-1].startswith(f"refused of clock {ME}: a stamp in the future")
    send(intake, 0.5, stamp=monotonic_ns() - 10**9)
    assert value_of(local.tick()) is None
    assert "already stale, expected one younger than 0.1 s" in local.data.refusals.latest
    assert local.data.refusals.count == 2
    assert local.data.owners["REMOTE"] == ""


def test_a_sample_that_was_overtaken_is_passed_over(local):
    intake = local.intake()
    local.enter_remote()
    now = monotonic_ns()
    send(intake, 0.1, stamp=now)
    assert value_of(local.tick()) == 0.1
    send(intake, 0.2, stamp=now - 1_000_000)
    assert value_of(local.tick()) == 0.1


def test_what_is_no_command_is_refused_by_name(local):
    intake = local.intake("wrong")
    local.enter_remote()
    three, zeros = [0.0] * 3, [[0.0] * 3] * 4
    latest = []

    def tick():
        record = local.tick()
        latest.append(local.data.refusals.latest.removeprefix(f"wrong {ME}: "))
        return record

    intake.remote(("shoulder", "wrist", "elbow"), three, *zeros)
    tick()
    intake.remote(rig.JOINTS, [0.0, float("nan"), 0.0], *zeros)
    tick()
    intake.remote(rig.JOINTS[:2], *[[0.0, 0.0]] * 5)
    tick()
    intake.live("pedals", [1.0])
    tick()
    intake.live("keys", [1.0])
    tick()
    intake.live("keys", [1.0, 0.0], timeout=60.0)
    assert tick().output.command.stiffness.tolist() == [0.0] * 3
    assert latest == [
        "remote command: joint_names are shoulder, wrist, elbow, expected shoulder, elbow, wrist in this order",
        "remote command's position of elbow is nan, expected a finite number from -1e+06 to 1e+06",
        "remote command: joint_names are shoulder, elbow, expected shoulder, elbow, wrist in this order",
        "live input 'pedals' is not observed; the policy observes: keys",
        "live input 'keys': has 1 values, expected 2, all finite",
        "live input 'keys': timeout is 60 s, expected 0 to 5 s",
    ]
    assert local.data.owners["REMOTE"] == ""
    with pytest.raises(ValueError, match="expected 3 values in each field"):
        intake.remote(rig.JOINTS, [0.0], *zeros)


def test_bytes_that_are_no_sample_do_nothing(local):
    for data in (b"", b"x" * 100, DATA_MAGIC, DATA_HEAD.pack(DATA_MAGIC, 0, 0, 60_000, 60_000, 1, 1), b"\0" * 20_000):
        datagram(local.registration.data, data)
    datagram(local.registration.data, DATA_HEAD.pack(DATA_MAGIC, 99, 0, 1, 0, 1, 1) + b"x" + bytes(8))
    datagram(local.registration.data, DATA_HEAD.pack(DATA_MAGIC, 1, 0, 1, 0, 1, 1) + b"x" + bytes(7))
    record = local.tick()
    assert record.input.remote is None
    assert [line for line in local.data.refusals.lines if "kind 99, expected 0 to 4" in line]


# The velocity.


def velocity(record):
    """As it is observed."""
    state = record.input.state
    return [float(x) for x in state.extern["velocity_command"].at(state.time)]


def test_a_velocity_belongs_to_whoever_last_changed_it_deliberately(local):
    stick, page = local.intake("gamepad"), local.intake("console")
    stick.velocity(0.0, 0.0, 0.0, deliberate=False)
    assert velocity(local.tick()) == [0.0, 0.0, 0.0]
    assert local.data.owners["velocity"] == ""
    page.velocity(0.4, 0.0, 0.1, deliberate=True)
    assert velocity(local.tick()) == [0.4, 0.0, 0.1]
    stick.velocity(0.0, 0.0, 0.0, deliberate=False)  # a stick at rest claims nothing
    page.velocity(0.4, 0.0, 0.1, deliberate=False)  # repeated, because it is still meant
    assert velocity(local.tick()) == [0.4, 0.0, 0.1]
    assert local.data.owners["velocity"] == f"console {ME}"
    stick.velocity(-0.2, 0.0, 0.0, deliberate=True)
    page.velocity(0.4, 0.0, 0.1, deliberate=False)
    assert velocity(local.tick()) == [-0.2, 0.0, 0.0]
    assert local.data.owners["velocity"] == f"gamepad {ME}"
    told = f"velocity: controlled by gamepad {ME}; move a stick or a slider, or press a key, to take it over"
    assert local.told[-1] == f"refused of console {ME}: {told}"
    local.velocity.press("w")
    stick.velocity(-0.2, 0.0, 0.0, deliberate=False)
    assert velocity(local.tick()) == [-0.1, 0.0, 0.0]
    assert local.data.owners["velocity"] == "keyboard"


def test_a_velocity_source_that_falls_silent_commands_zero_within_its_timeout(local):
    intake = local.intake()
    intake.velocity(0.5, 0.0, 0.0, deliberate=True)
    assert velocity(local.tick()) == [0.5, 0.0, 0.0]
    sent = local.time
    while velocity(local.tick()) != [0.0, 0.0, 0.0]:
        assert local.time - sent <= 0.25 + 1e-9
    assert local.data.owners["velocity"] == ""
    assert local.data.status()["lost"] == {"velocity": f"test {ME}"}
    local.velocity.press("w")  # from rest, not from what was commanded before
    for _ in range(50):
        assert velocity(local.tick()) == [0.1, 0.0, 0.0]
    assert local.data.status()["lost"] == {}
    for value in (0.5, 0.0):  # who stops it and falls silent then is not missed
        intake.velocity(value, 0.0, 0.0, deliberate=True)
        local.tick()
    for _ in range(20):
        local.tick()
    assert (local.data.owners["velocity"], local.data.status()["lost"]) == ("", {})


def test_an_absurd_velocity_is_bounded_or_refused(local):
    intake = local.intake()
    intake.velocity(1e9, -1e9, 100.0, deliberate=True)
    assert velocity(local.tick()) == [10.0, -10.0, pytest.approx(4.0 * np.pi, abs=1e-6)]
    intake.velocity(float("nan"), 0.0, 0.0, deliberate=True)
    local.tick()
    assert "not four finite numbers" in local.told[-1]


# Live inputs, heartbeats.


def test_live_inputs_reach_the_state_and_expire(local):
    first, second = local.intake("first"), local.intake("second")
    first.live("keys", [1.0, 0.0], timeout=0.1)
    keys = local.tick().input.state.extern["keys"]
    assert keys.value.tolist() == [1.0, 0.0]
    assert keys.timeout == 0.1
    second.live("keys", [0.0, 1.0])
    assert local.tick().input.state.extern["keys"].value.tolist() == [1.0, 0.0]
    assert local.told[-1] == f"refused of second {ME}: live input 'keys': belongs to first {ME}"
    for _ in range(6):
        state = local.tick().input.state
    assert state.extern["keys"].at(state.time).tolist() == [0.0, 0.0]
    second.live("keys", [0.0, 1.0])
    state = local.tick().input.state
    assert state.extern["keys"].at(state.time).tolist() == [0.0, 1.0]


def test_the_contract_says_when_a_live_input_is_stale_and_its_producer_may_shorten_it(runtime):
    local = LocalSession(takes={"keys": 2, "feet": 1, "mood": 1}, timeouts={"keys": 0.2, "mood": math.inf})
    with local.stack:
        intake = local.intake()

        def timeouts(**given):
            for name, width in local.takes.items():
                intake.live(name, [1.0] * width, **given)
            extern = local.tick().input.state.extern
            return [extern[name].timeout for name in local.takes]

        assert timeouts() == [0.2, 0.5, math.inf]
        assert timeouts(timeout=0.1) == [0.1, 0.1, 0.1]
        assert timeouts(timeout=2.0) == [0.2, 2.0, 2.0]
        assert timeouts() == [0.2, 0.5, math.inf]


def test_a_live_input_that_never_gets_stale_has_a_new_producer_once_its_first_is_silent(runtime):
    local = LocalSession(timeouts={"keys": math.inf})
    with local.stack:
        first, second = local.intake("first"), local.intake("second")
        first.live("keys", [1.0, 0.0])
        local.tick()
        second.live("keys", [0.0, 1.0])
        assert local.tick().input.state.extern["keys"].value.tolist() == [1.0, 0.0]
        for _ in range(26):
            local.tick()
        assert local.data.owners["keys"] == ""
        state = local.tick().input.state
        assert state.extern["keys"].at(state.time).tolist() == [1.0, 0.0]
        second.live("keys", [0.0, 1.0])
        assert local.tick().input.state.extern["keys"].value.tolist() == [0.0, 1.0]


def test_heartbeats_are_kept_by_name(local):
    local.intake("gamepad").heartbeat()
    local.tick()
    assert local.data.heartbeats == {"gamepad": pytest.approx(local.time, abs=0.02)}


# Floods.


def test_a_damp_sent_during_a_flood_of_data_acts_in_the_next_tick(local):
    """At 10 kHz and above: four threads that send without pause, and a slow loop."""
    stop = threading.Event()
    attempts = [0] * 4
    zeros = [0.0] * 3

    def flood(i):
        intake = local.intake(f"flood {i}")
        intake._data.setblocking(False)
        while not stop.is_set():
            intake.velocity(1.0, 0.0, 0.0, deliberate=True)
            intake.remote(rig.JOINTS, zeros, zeros, zeros, zeros, zeros)
            attempts[i] += 2

    threads = [threading.Thread(target=flood, args=(i,)) for i in range(4)]
    operator = local.intake("operator")
    for thread in threads:
        thread.start()
    try:
        for _ in range(20):
            local.tick(Intent.LOAD_A)
            time.sleep(0.005)
            token = operator.post("damp")
            record = local.tick()
            assert Intent.DAMP in record.input.intents
            assert record.output.control_mode.mode is Mode.DAMPING
            assert operator.answer(token, 1.0).granted
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert sum(attempts) > 2000


def test_quarrels_are_told_at_a_bounded_rate(local):
    first, second = local.intake("first"), local.intake("second")
    for _ in range(50):  # a second
        first.velocity(0.1, 0.0, 0.0, deliberate=True)
        local.tick()
        second.velocity(0.2, 0.0, 0.0, deliberate=True)
        local.tick()
    assert 10 <= len(local.told) <= 40


def test_an_intake_says_that_the_session_has_ended(local):
    intake = local.intake()
    local.data.close()
    local.data.close()
    with pytest.raises(SessionError, match="has ended"):
        intake.heartbeat()
