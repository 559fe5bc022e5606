"""Commands and live inputs from outside: what counts, and for how long."""

import numpy as np
import pytest
from control_run import MEASURED, PASSIVE_KD, REMOTE, RL, A, Policy, Run, bits, command, is_damping

from humanoid_sim.messages import Intent, RemoteCommand
from humanoid_sim.mit import Extern

PASSIVE = "passive"


def in_force(output):
    """Position of the remote command in force, or PASSIVE: every joint braked where it is."""
    sent = output.command
    if sent.stiffness.any():
        return sent.position[0]
    assert sent.position.tolist() == list(MEASURED.values())
    assert sent.damping.tolist() == [PASSIVE_KD] * 3
    assert not sent.velocity.any()
    assert not sent.effort.any()
    return PASSIVE


def remote(arrival, position=0.7):
    return RemoteCommand(command(position), arrival)


def in_remote(stale_command_policy, *steps):
    """REMOTE is entered at 10.0 s; what is in force at each `(time, latest command)`."""
    run = Run(stale_command_policy=stale_command_policy).reach(A)
    run.time = 10.0
    seen = [in_force(run.step(Intent.START_REMOTE))]
    for time, latest in steps:
        run.time = time
        output = run.step(remote=latest)
        assert output.control_mode.controller_name == REMOTE
        seen.append(in_force(output))
    assert seen.pop(0) == PASSIVE, "nothing has come yet"
    return seen


@pytest.mark.parametrize(("policy", "late"), [("passive", PASSIVE), ("hold", 0.7)])
def test_a_remote_command_is_stale_100_ms_after_it_arrived(policy, late):
    first = remote(10.01)
    times = (10.02, 10.06, 10.109, 10.111, 10.2, 99.0)
    assert in_remote(policy, *((time, first) for time in times)) == [0.7, 0.7, 0.7, late, late, late]
    seen = in_remote(policy, (10.02, first), (10.2, first), (10.21, remote(10.205, 0.8)), (10.31, remote(10.205, 0.8)))
    assert seen == [0.7, late, 0.8, 0.8 if policy == "hold" else PASSIVE]


@pytest.mark.parametrize("policy", ["passive", "hold"])
@pytest.mark.parametrize("arrival", [-1e9, 9.95, 10.0, float("nan"), float("-inf")])
def test_a_remote_command_from_before_activation_never_counts(policy, arrival):
    old = remote(arrival)
    assert in_remote(policy, (10.02, old), (10.04, old), (10.5, old)) == [PASSIVE] * 3


def test_no_clock_makes_a_dead_sender_live():
    future = remote(1e6)
    assert in_remote("passive", *((t, future) for t in (10.02, 10.1, 10.13, 500.0))) == [0.7, 0.7, PASSIVE, PASSIVE]
    first = remote(10.01)
    jumps_back = (10.02, 10.06, 10.2, 10.02, 5.0)
    assert in_remote("passive", *((t, first) for t in jumps_back)) == [0.7, 0.7, *[PASSIVE] * 3]


def test_a_remote_command_leaves_as_it_came():
    run = Run().reach(REMOTE)
    wanted = command(position=np.array([0.3, 0.4, 0.5]), velocity=np.array([4.0, 5.0, 6.0]))
    assert bits(run.step(remote=RemoteCommand(wanted, run.time)).command) == bits(wanted)


@pytest.mark.parametrize(
    "bad", [command(stiffness=np.array([1.0, np.nan, 1.0])), command(damping=-np.ones(3)), command(n=2)]
)
def test_a_broken_remote_command_damps_in_that_tick(bad):
    run = Run().reach(REMOTE)
    assert is_damping(run.step(remote=RemoteCommand(bad, run.time)))


@pytest.mark.parametrize(
    ("is_floating", "age", "is_granted"),
    [(True, None, False), (True, 0.11, False), (True, 0.09, True), (False, None, True)],
)
def test_a_robot_that_must_be_balanced_goes_to_remote_only_with_a_producer_that_sends(is_floating, age, is_granted):
    run = Run(is_floating=is_floating).reach(A)
    output = run.step(Intent.START_REMOTE, remote=None if age is None else remote(run.time - age))
    assert output.control_mode.controller_name == (REMOTE if is_granted else A)
    assert ("START_REMOTE refused" in output.control_mode.status_message) != is_granted


def test_a_policy_waits_for_its_live_inputs_and_does_not_outlive_them():
    policy = Policy()
    run = Run(policy=policy, live={"foot_contact": 2}).reach(A)

    def live(age):
        return {"foot_contact": Extern([1.0, 0.5], run.time - age, timeout=0.2)}

    for extern in ({}, live(0.21)):
        output = run.step(Intent.START_LOCOMOTION, extern=extern)
        assert output.control_mode.controller_name == A
        assert "START_LOCOMOTION refused" in output.control_mode.status_message
        assert "foot_contact" in output.control_mode.status_message
    assert not policy.seen
    assert run.step(Intent.START_LOCOMOTION, extern=live(0.19)).control_mode.controller_name == RL
    assert policy.seen[-1][-2:].tolist() == [1.0, 0.5]
    run.step(extern=live(0.19))
    assert run.step(extern=live(0.19)).control_mode.controller_name == RL
    run.step(extern=live(0.19))
    assert is_damping(run.step(extern=live(0.21)))


def test_a_velocity_command_that_is_too_old_is_zero():
    policy = Policy()
    run = Run(policy=policy).reach(RL)
    sent = Extern([0.5, 0.0, -0.25], run.time, timeout=0.25)
    begun = run.time
    for _ in range(20):
        count = len(policy.seen)
        output = run.step(extern={"velocity_command": sent})
        assert output.control_mode.controller_name == RL
        if len(policy.seen) > count:
            is_fresh = run.time - 0.02 - begun <= 0.25
            assert policy.seen[-1][-3:].tolist() == ([0.5, 0.0, -0.25] if is_fresh else [0.0, 0.0, 0.0])
    assert len(policy.seen) >= 10
