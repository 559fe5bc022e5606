import threading
from contextlib import suppress

import pytest
from local_session import datagram

from humanoid_sim.client import Answer, monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode, SafetyLevel, SafetyStatus
from humanoid_sim.session.intent_socket import IntentSocket


def seen_then(local):
    """The stamp of the newest tick, as a reader of the feed has it."""
    return local.sent


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


def test_broken_messages_do_nothing(local):
    for data in (b"", b"\xff\xfe", b"\n\n\n", b"damp " * 2, b"load_a\n\n\n" + b"9" * 5000):
        datagram(local.registration.path / "intents", data)
    assert local.tick().input.intents == ()


def test_the_longest_safety_status_damps(local):
    local.tick(Intent.DAMP)
    local.intake("lidar").post_safety("\U0001f600" * 80, 2, "\U0001f600" * 300, flags=2**32 - 1)
    assert not local.tick().input.safety[0].is_ok


def test_everything_in_the_socket_is_taken_in_one_tick_and_a_flood_costs_a_bounded_time(local):
    sent = 0
    with suppress(BlockingIOError):
        while sent < 10_000:
            datagram(local.registration.path / "intents", f"load_b\n\n\n{monotonic_ns()}".encode())
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
        assert len(local.tick().input.intents) <= local.intents._mailbox.capacity
    stop.set()
    while thread.is_alive():
        local.tick()
    thread.join()
    assert sent <= first


def test_the_folder_is_for_its_user_alone_and_a_path_too_long_is_one_line(local, tmp_path):
    assert local.registration.path.stat().st_mode & 0o777 == 0o700
    with pytest.raises(InputError, match="cannot listen: AF_UNIX path too long"):
        IntentSocket(tmp_path / ("d" * 120))


def test_a_policy_is_selected_at_rest_and_refused_in_motion_or_late(local):
    operator = local.intake("operator")
    for name, mode, is_granted in (
        ("dance", (), True),
        ("danse", (), False),
        ("walk", (Intent.DAMP, Intent.LOAD_A), False),
    ):
        for intent in mode:
            local.tick(intent)
        token = operator.post(f"policy {name}")
        assert local.tick().input.policy == name
        assert operator.answer(token, 1.0).granted is is_granted
    token = operator.post("policy walk", seen=monotonic_ns() - 600_000_000)
    assert local.tick().input.policy == ""
    assert "too late" in operator.answer(token, 1.0).text
    token = operator.post("policy")
    local.tick()
    assert "policy NAME" in operator.answer(token, 1.0).text
