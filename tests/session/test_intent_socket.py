import pytest

from humanoid_sim.client import Answer, monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode, SafetyLevel, SafetyStatus
from humanoid_sim.session.intent_socket import IntentSocket


@pytest.mark.parametrize("passive", [Mode.DAMPING, Mode.ZERO_TORQUE])
def test_what_was_meant_for_the_mode_before_is_refused_however_young(local, passive):
    """A safety status made the robot passive, or a fresh start."""
    local.tick(Intent.DAMP)
    local.tick(Intent.LOAD_A)
    standing = local.sent
    if passive is Mode.DAMPING:
        local.robot.safety = (SafetyStatus(SafetyLevel.FAULT, source="imu"),)
    else:
        local.session.memory, local.session._output = local.session.supervisor.initial(), None
    local.tick()
    local.robot.safety = ()
    operator = local.intake("operator")
    token = operator.post("load_b", seen=standing)
    assert local.tick().input.intents == ()
    answer = operator.answer(token, 1.0)
    assert answer.text.startswith(f"LOAD_B refused: the robot went to {passive.name} meanwhile")
    token = operator.post("damp" if passive is Mode.ZERO_TORQUE else "load_b", seen=local.sent)
    mode = local.tick().output.control_mode
    text = f"{mode.mode.name} ({mode.controller_name}): {mode.status_message}"
    assert operator.answer(token, 1.0) == Answer(True, text), "one who saw it may ask at once"


@pytest.mark.parametrize(
    ("word", "is_granted"), [("damp", True), ("quit", True), ("reactivate", False), ("load_a", False)]
)
def test_what_the_end_of_the_session_overtook_is_not_granted(local, word, is_granted):
    operator = local.intake("operator")
    token = operator.post(word)
    local.intents.poll(0.0, None)
    local.intents.close()
    assert operator.answer(token, 1.0) == Answer(is_granted, "the session has ended")


def test_the_longest_safety_status_damps(local):
    local.tick(Intent.DAMP)
    local.intake("lidar").post_safety("\U0001f600" * 80, 2, "\U0001f600" * 300, flags=2**32 - 1)
    assert not local.tick().input.safety[0].is_ok


def test_the_folder_is_for_its_user_alone_and_a_path_too_long_is_one_line(local, tmp_path):
    assert local.registration.path.stat().st_mode & 0o777 == 0o700
    with pytest.raises(InputError, match="cannot listen: AF_UNIX path too long"):
        IntentSocket(tmp_path / ("d" * 120))


def test_a_late_selection_of_a_policy_and_words_without_a_meaning_are_refused(local):
    operator = local.intake("operator")
    for word, seen, refusal in (
        ("policy walk", monotonic_ns() - 600_000_000, "too late"),
        ("policy", None, "policy NAME"),
        ("push 1,0", None, "means nothing"),
    ):
        token = operator.post(word, seen=seen)
        assert local.tick().input.policy == ""
        assert refusal in operator.answer(token, 1.0).text
