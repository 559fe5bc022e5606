"""Whatever fails in a tick, the command of that tick is finite, complete, and from the fallback."""

import numpy as np
import pytest
from control_run import (
    DAMPING,
    JOINTS,
    MEASURED,
    REMOTE,
    RL,
    ZERO,
    A,
    B,
    Policy,
    Run,
    bits,
    command,
    is_damping,
)
from control_surface import controller, fault, step

from humanoid_sim.messages import Intent, RemoteCommand
from humanoid_sim.mit import MITCommand

NAN, INF = float("nan"), float("inf")


def fails(*_):
    raise RuntimeError("out of memory")


BAD_ANSWERS = {
    "NaN": np.array([NAN, 0.0], np.float32),
    "inf": np.array([0.0, INF], np.float32),
    "minus inf": np.array([-INF, 0.0], np.float32),
    "beyond the limit": np.array([0.0, 101.0], np.float32),
    "beyond float32": np.array([0.0, 1e300]),
    "too few": np.zeros(1, np.float32),
    "too many": np.zeros(3, np.float32),
    "a batch": np.zeros((1, 2), np.float32),
    "empty": np.zeros(0, np.float32),
    "None": None,
    "a text": "damp",
    "an exception": fails,
}


@pytest.mark.parametrize("at_start", [True, False], ids=["at START", "later"])
@pytest.mark.parametrize("answer", BAD_ANSWERS.values(), ids=BAD_ANSWERS)
def test_a_policy_that_fails_is_damped_in_the_same_tick(answer, at_start):
    policy = Policy()
    run = Run(policy=policy).reach(A if at_start else RL)
    policy.answer = answer
    count = len(policy.seen)
    output = run.step(*[Intent.START_LOCOMOTION] if at_start else [])
    if not at_start:
        assert output.control_mode.controller_name == RL, "the policy runs in every second tick"
        output = run.step()
    assert len(policy.seen) == count + 1
    assert is_damping(output)
    assert RL in output.control_mode.status_message
    assert output.faults
    policy.answer = np.zeros(2, np.float32)
    assert all(is_damping(run.step()) for _ in range(10)), "nothing recovers by itself"


def test_a_policy_within_its_limit_goes_on():
    output = Run(policy=Policy(np.array([100.0, -100.0], np.float32))).reach(RL).step()
    assert output.control_mode.controller_name == RL
    assert output.command.position.tolist() == [0.03 - 25.0, 0.02 + 50.0, 0.0]


def test_an_observation_that_is_not_finite_never_reaches_the_policy():
    policy = Policy()
    run = Run(policy=policy).reach(RL)
    run.step()
    count = len(policy.seen)
    output = run.step(position={**MEASURED, "elbow": NAN})
    assert is_damping(output)
    assert len(policy.seen) == count
    assert output.command.position.tolist() == [0.4, 0.0, 0.6]


BAD_COMMANDS = {
    "raises": fails,
    "a fault": lambda _: fault("tired"),
    "None": lambda _: None,
    "a text": lambda _: "damp",
    "NaN": lambda _: command(damping=np.array([1.0, NAN, 1.0])),
    "inf": lambda _: command(position=INF),
    "minus inf": lambda _: command(effort=np.array([0.0, 0.0, -INF])),
    "a negative gain": lambda _: command(stiffness=np.array([1.0, 1.0, -2.0])),
    "too few joints": lambda _: command(n=2),
    "a batch": lambda _: MITCommand.zeros(1, 3),
}


@pytest.mark.parametrize("update", BAD_COMMANDS.values(), ids=BAD_COMMANDS)
@pytest.mark.parametrize(
    ("name", "before", "intent"), [(B, DAMPING, Intent.LOAD_B), (RL, A, Intent.START_LOCOMOTION)], ids=["standby", "rl"]
)
def test_a_controller_that_fails_is_damped_in_the_same_tick(name, before, intent, update):
    run = Run(replaced={name: controller(name, JOINTS, update)}).reach(before)
    output = run.step(intent)
    assert is_damping(output)
    assert name in output.control_mode.status_message
    assert is_damping(run.step())


def test_a_controller_that_raises_when_it_is_activated_is_damped_in_the_same_tick():
    broken = controller(REMOTE, JOINTS, lambda _: command(), activate=fails)
    output = Run(replaced={REMOTE: broken}).reach(A).step(Intent.START_REMOTE)
    assert is_damping(output)
    assert "out of memory" in output.control_mode.status_message


@pytest.mark.parametrize("update", BAD_COMMANDS.values(), ids=BAD_COMMANDS)
def test_zero_torque_takes_over_from_damping_in_the_same_tick(update):
    run = Run(replaced={DAMPING: controller(DAMPING, JOINTS, update)})
    output = run.step(Intent.DAMP)
    assert output.control_mode.controller_name == ZERO
    assert bits(output.command) == [bytes(3 * 8)] * 5


def test_the_whole_chain_acts_in_one_tick():
    policy = Policy(fails)
    broken = controller(DAMPING, JOINTS, fails)
    run = Run(policy=policy).reach(A)
    stack = Run(policy=policy, replaced={DAMPING: broken}).stack
    _, output = step(stack, run.memory, run.input(Intent.START_LOCOMOTION))
    assert output.control_mode.controller_name == ZERO
    assert bits(output.command) == [bytes(3 * 8)] * 5
    for name in (RL, DAMPING):
        assert name in output.control_mode.status_message


def test_damping_goes_on_from_where_it_was_if_a_pose_cannot_be_loaded():
    run = Run().reach(DAMPING)
    output = run.step(Intent.LOAD_A, position={**MEASURED, "wrist": NAN})
    assert is_damping(output)
    assert output.command.position.tolist() == list(MEASURED.values())


GUARDS = {
    "lower": -1.0,
    "upper": 1.0,
    "effort_limit": 10.0,
    "following_effort": 8.0,
    "following_time": 0.1,
    "following_progress": 0.02,
    "limit_margin": 0.1,
    "limit_time": 0.04,
    "speed_limit": 5.0,
    "speed_time": 0.02,
}


@pytest.mark.parametrize(
    ("what", "measured", "position", "ticks", "word"),
    [
        ("K_p times the error is 16 N·m, and the joint stays", {}, 0.9, 6, "following"),
        ("beyond a limit and pushed outward", {"position": dict.fromkeys(JOINTS, 1.2)}, 1.3, 3, "limit"),
        ("too fast", {"velocity": -5.1}, 0.5, 2, "speed"),
    ],
    ids=["following", "limit", "speed"],
)
def test_a_guard_that_trips_ends_in_damping_in_that_tick(what, measured, position, ticks, word):
    run = Run(guards=GUARDS).reach(REMOTE)
    measured = {"position": dict.fromkeys(JOINTS, 0.5), **measured}
    for _ in range(ticks - 1):
        output = run.step(remote=RemoteCommand(command(position), run.time), **measured)
        assert output.control_mode.controller_name == REMOTE, what
    output = run.step(remote=RemoteCommand(command(position), run.time), **measured)
    assert is_damping(output), what
    assert word in output.control_mode.status_message
    assert JOINTS[0] in output.control_mode.status_message
    assert is_damping(run.step()), "nothing recovers by itself"


@pytest.mark.parametrize("name", [A, RL, REMOTE])
def test_guards_watch_every_mode_that_drives(name):
    run = Run(guards=GUARDS).reach(name)
    outputs = [run.step(velocity=6.0, remote=RemoteCommand(command(0.5), run.time)) for _ in range(3)]
    assert is_damping(outputs[1])


def test_a_guard_does_not_trip_on_what_passes():
    run = Run(guards=GUARDS).reach(REMOTE)
    for i in range(50):
        moving = dict.fromkeys(JOINTS, 0.5 + 0.006 * i)  # comes nearer by 0.03 rad in 0.1 s
        remote = RemoteCommand(command(moving["elbow"] + 0.3), run.time)
        assert run.step(remote=remote, position=moving).control_mode.controller_name == REMOTE
