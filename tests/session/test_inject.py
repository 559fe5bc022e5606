import numpy as np
import pytest
import rig

from humanoid_sim.errors import InputError
from humanoid_sim.messages import OK, SafetyFlag, SafetyLevel
from humanoid_sim.session.inject import Injection, Injector, parse_injections
from humanoid_sim.session.sources import RemoteInbox


@pytest.fixture
def time():
    return [0.0]


def injector(time, *texts):
    return Injector(parse_injections(texts), lambda: time[0])


def test_the_grammar():
    assert parse_injections([]) == ()
    assert parse_injections(["nan_policy@5", "safety@0", "silent_remote@1.5e0"]) == (
        Injection("nan_policy", 5.0),
        Injection("safety", 0.0),
        Injection("silent_remote", 1.5),
    )


@pytest.mark.parametrize(
    "text", ["", "@", "safety", "safety@", "safety@x", "safety@-1", "safety@nan", "safety@inf", "fire@3"]
)
def test_a_bad_item_is_refused_with_what_is_accepted(text):
    with pytest.raises(InputError) as caught:
        parse_injections(["safety@1", text])
    assert str(caught.value) == (
        f"--inject: is '{text}', expected FAULT@SECONDS with FAULT one of nan_policy, safety, silent_remote"
    )


def test_without_injections_nothing_changes(time):
    none, box = injector(time), RemoteInbox(rig.JOINTS, lambda: 0.0)
    assert none.policy(rig.good_answer) is rig.good_answer
    assert none.safety((OK,)) == (OK,)
    assert none.remote(box) is box
    assert none.pending == ()


def test_a_policy_answers_nan_from_the_time_on(time):
    policy = injector(time, "nan_policy@2", "nan_policy@7").policy(lambda *_: np.ones(2))
    observation = np.zeros(3, dtype=np.float32)
    for now, is_nan in ((1.99, False), (2.0, True), (100.0, True)):
        time[0] = now
        answer = np.asarray(policy(observation, 0))
        assert answer.shape == (2,)
        assert np.isnan(answer).all() == is_nan
        assert np.isnan(answer).any() == is_nan


@pytest.mark.parametrize(
    ("now", "fails"),
    [(0.99, False), (1.0, True), (1.095, True), (1.105, False), (2.0, False), (3.05, True), (3.2, False)],
)
def test_a_safety_fault_lasts_a_tenth_of_a_second_each_time(time, now, fails):
    time[0] = now
    statuses = injector(time, "safety@1", "safety@3").safety((OK,))
    assert statuses[0] is OK
    assert len(statuses) == 1 + fails
    if fails:
        assert (statuses[1].level, statuses[1].flags) == (SafetyLevel.FAULT, SafetyFlag.MOTOR_FAULT)
        assert "deliberately" in statuses[1].message


def test_a_silent_remote_repeats_the_last_command_from_before(time):
    box = RemoteInbox(rig.JOINTS, lambda: time[0])
    silenced = injector(time, "silent_remote@2").remote(box)
    assert silenced.latest() is None
    time[0] = 1.0
    box.put(rig.JOINTS, rig.command(0.1))
    assert silenced.latest() is box.latest()
    time[0] = 2.0
    box.put(rig.JOINTS, rig.command(0.2))
    latest = silenced.latest()
    assert latest.arrival_time == 1.0


def test_what_never_took_effect_is_told(time):
    texts = ["nan_policy@2", "safety@1", "safety@9", "silent_remote@3"]
    faults = injector(time, *texts)
    policy, box = faults.policy(lambda *_: np.ones(2)), faults.remote(RemoteInbox(rig.JOINTS, lambda: time[0]))
    time[0] = 1.05
    faults.safety((OK,))
    policy(np.zeros(3, dtype=np.float32), 0)
    box.latest()
    assert faults.pending == ("nan_policy@2", "safety@9", "silent_remote@3")
    time[0] = 4.0
    box.latest()
    assert faults.pending == ("nan_policy@2", "safety@9")  # its time has passed, but no policy ran any more
    policy(np.zeros(3, dtype=np.float32), 0)
    assert faults.pending == ("safety@9",)
