import os
import re
import threading
from contextlib import suppress

import pytest
from fakes import FakeRobot
from local_session import datagram

from humanoid_sim.client import Answer, Feed, SessionError, monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode, SafetyLevel, SafetyStatus
from humanoid_sim.session.intent_socket import IntentSocket, RateLimit, queue_length


def asked(local, *words, more=()):
    """Post all words before one tick, with intents from elsewhere; the answers."""
    intakes = [local.intake(f"asker {i}") for i in range(len(words))]
    tokens = [intake.post(word) for intake, word in zip(intakes, words, strict=True)]
    local.tick(*more)
    return [intake.answer(token, 1.0) for intake, token in zip(intakes, tokens, strict=True)]


def test_an_intent_acts_in_the_next_tick_which_answers(local):
    assert asked(local, "damp") == [Answer(True, "DAMPING (damping_controller): DAMP requested")]
    assert local.told == [f"DAMP requested by asker 0 ({os.getpid()})"]
    assert [answer.granted for answer in asked(local, "load_b", "load_a")] == [True, False], "the first of two"
    answers = asked(local, "start_remote", "damp", "load_b", more=(Intent.QUIT,))
    assert [answer.granted for answer in answers] == [False, True, False], "whatever else is refused in its tick"
    assert all("LOAD_B refused: DAMP came in the same tick" in answer.text for answer in answers)


def seen_then(local):
    """The stamp of the newest tick, as a reader of the feed has it."""
    with Feed(local.info) as feed:
        sample = feed.latest()
    return sample.stamp


WORDS = ("load_a", "load_b", "start_locomotion", "start_remote", "quit", "reactivate")


@pytest.mark.parametrize("word", WORDS)
def test_what_was_meant_for_a_robot_of_long_ago_is_refused(local, word):
    """A page whose bytes were held, a program that stood still: only DAMP is never too late."""
    local.tick(Intent.DAMP)
    late, stopped = local.intake("late"), local.intake("stopped")
    long_ago = monotonic_ns() - 600_000_000
    tokens = late.post(word, seen=long_ago), stopped.post("damp", seen=long_ago)
    assert local.tick().input.intents == (Intent.DAMP,)
    assert not local.reactivation.is_asked
    answer = late.answer(tokens[0], 1.0)
    name = word.partition(" ")[0].upper()
    assert not answer.granted
    assert re.fullmatch(
        rf"{name} refused: too late, it was meant for the robot of 0\.\d\d s ago, at most 0.5 s.*", answer.text
    )
    assert f"{answer.text}; requested by late ({os.getpid()})" in local.told
    assert stopped.answer(tokens[1], 1.0).granted


@pytest.mark.parametrize("passive", [Mode.DAMPING, Mode.ZERO_TORQUE])
def test_what_was_meant_for_the_mode_before_is_refused_however_young(local, passive):
    """Whatever made the robot passive: an operator, a safety status, a fresh start."""
    local.tick(Intent.DAMP)
    local.tick(Intent.LOAD_A)
    standing = seen_then(local)
    if passive is Mode.DAMPING:
        local.safety = (SafetyStatus(SafetyLevel.FAULT, source="imu"),)
        local.tick()
        local.safety = ()
    else:
        local.run.memory, local.output = local.run.supervisor.initial(), None
        local.tick()
    operator = local.intake("operator")
    token = operator.post("load_b", seen=standing)
    assert local.tick().input.intents == ()
    answer = operator.answer(token, 1.0)
    unseen = f"the robot went to {passive.name} meanwhile, which its sender had not seen"
    assert answer.text == f"LOAD_B refused: {unseen}; look, and ask again"
    token = operator.post("damp" if passive is Mode.ZERO_TORQUE else "load_b", seen=seen_then(local))
    local.tick()
    assert operator.answer(token, 1.0).granted


def test_whoever_saw_the_tick_that_damped_may_ask_at_once(local):
    local.tick(Intent.DAMP)
    operator = local.intake("operator")
    token = operator.post("load_a", seen=seen_then(local))
    local.tick()
    assert operator.answer(token, 1.0) == Answer(True, "STANDBY (standby_controller_a): LOAD_A requested")


@pytest.mark.parametrize("end", [b"", b"\n", b"\nsoon", b"\n-1", "\n²".encode()])
def test_a_client_of_an_older_version_is_told_to_update(local, end):
    local.tick(Intent.DAMP)
    datagram(local.registration.intents, b"load_a\nold (1)\n7" + end)
    datagram(local.registration.intents, b"damp\nold (1)\n8" + end)
    assert local.tick().input.intents == (Intent.DAMP,)
    assert any("update the sender's client.py" in line and "old (1)" in line for line in local.told)


def test_a_mark_is_recorded_and_what_means_nothing_is_said(local):
    marked, strange, long = asked(local, "mark it\nslipped", "jump", "é" * 3000)
    assert marked == Answer(True, "marked")
    assert strange.text.startswith("'jump' means nothing, expected one of damp, load_a, ")
    assert not strange.granted
    assert local.told == [f"mark of asker 0 ({os.getpid()}): it slipped"]
    assert not long.granted


def test_broken_messages_do_nothing(local):
    for data in (b"", b"\xff\xfe", b"\n\n\n", b"damp " * 2):
        datagram(local.registration.intents, data)
    assert local.tick().input.intents == ()


def test_reactivate_is_answered_once_the_session_has_served_it(local):
    intake = local.intake()
    token = intake.post("reactivate")
    local.tick()
    assert local.reactivation.is_asked
    with pytest.raises(SessionError, match=r"did not answer within 0.01 s"):
        intake.answer(token, 0.01)
    told, _ = local.reactivation.serve(FakeRobot(), Mode.DAMPING)
    local.tick()
    assert intake.answer(token, 1.0) == Answer(True, told)


def test_closing_answers_whoever_still_waits(local):
    intake = local.intake()
    token = intake.post("quit")
    local.intents.poll(0.0, None)
    local.intents.close()
    local.intents.close()
    assert intake.answer(token, 1.0) == Answer(True, "the session has ended")
    assert not local.registration.intents.exists()
    with pytest.raises(SessionError, match="cannot be reached"):
        intake.post("damp")


def test_everything_in_the_socket_is_taken_in_one_tick_and_a_flood_costs_a_bounded_time(local):
    sent = 0
    with suppress(BlockingIOError):
        while sent < 10_000:
            datagram(local.registration.intents, f"load_b\n\n\n{monotonic_ns()}".encode())
            sent += 1
    assert 1 < sent < 10_000
    stop = threading.Event()

    def flood():
        intake = local.intake("flood")
        while not stop.is_set():
            intake.post("load_a")

    thread = threading.Thread(target=flood)
    thread.start()
    first = len(local.tick().input.intents)
    for _ in range(20):
        assert len(local.tick().input.intents) <= queue_length() + 1
    stop.set()
    while thread.is_alive():
        local.tick()
    thread.join()
    assert sent <= first


def test_the_socket_is_for_its_user_alone_and_a_path_too_long_is_one_line(local, tmp_path):
    assert local.registration.intents.stat().st_mode & 0o777 == 0o600
    assert local.registration.data.stat().st_mode & 0o777 == 0o600
    with pytest.raises(InputError, match="cannot listen: AF_UNIX path too long"):
        IntentSocket(tmp_path / ("d" * 120))


def test_who_takes_no_answers_leaves_others_theirs(local):
    deaf, operator = local.intake("deaf"), local.intake("operator")
    for _ in range(100):
        for _ in range(5):
            deaf.post("damp")
        local.tick()
    token = operator.post("damp")
    local.tick()
    assert operator.answer(token, 1.0).granted


def test_marks_are_told_at_a_bounded_rate(local):
    operator = local.intake("operator")
    answers = []
    for i in range(200):  # four seconds
        token = operator.post(f"mark {i}")
        local.tick()
        answers.append(operator.answer(token, 1.0))
    told = [line for line in local.told if line.startswith("mark of operator")]
    assert 10 <= len(told) <= 60
    assert len(told) == sum(answer.granted for answer in answers)
    assert answers[-1].text in {"marked", "not marked: too many lines in a second"}


def test_a_rate_is_bounded_and_recovers():
    limit = RateLimit(5.0, 10)
    assert [limit.admits(100.0) for _ in range(12)] == [True] * 10 + [False] * 2
    assert [limit.admits(100.4) for _ in range(3)] == [True, True, False]
    assert [limit.admits(1000.0) for _ in range(11)] == [True] * 10 + [False]
