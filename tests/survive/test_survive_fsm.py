"""The five modes: every controller with every intent, safety first, and nothing that recovers by itself."""

import pytest
from control_run import DAMPING, MEASURED, PATHS, REMOTE, RL, ZERO, A, B, Run, bits, is_complete, is_damping
from control_surface import step

from humanoid_sim.messages import Intent, SafetyFlag, SafetyLevel, SafetyStatus

TABLE = """
             DAMP     LOAD_A   LOAD_B   START_LOCOMOTION  START_REMOTE  QUIT
zero         damping  -        -        -                 -             quit
damping      damping  a        b        -                 -             quit
a            damping  -        -        -                 -             -
a finished   damping  -        -        rl                remote        -
b            damping  -        -        -                 -             -
b finished   damping  -        -        rl                remote        -
rl           damping  -        -        -                 -             -
remote       damping  -        -        -                 -             -
"""
NAMES = {"zero": ZERO, "damping": DAMPING, "a": A, "b": B, "rl": RL, "remote": REMOTE}
MODES = {ZERO: "ZERO_TORQUE", DAMPING: "DAMPING", A: "STANDBY", B: "STANDBY", RL: "LOCOMOTION", REMOTE: "REMOTE"}
REQUIRED = {
    "LOAD_A": ("DAMPING",),
    "LOAD_B": ("DAMPING",),
    "START_LOCOMOTION": ("finished", "STANDBY"),
    "START_REMOTE": ("finished", "STANDBY"),
    "QUIT": ("ZERO_TORQUE", "DAMPING"),
}
"""Words that a refusal says of what would have been right."""


def rows():
    header, *lines = TABLE.strip("\n").splitlines()
    for line in lines:
        cells = line[13:].split()
        yield line[:13].split(), dict(zip(header.split(), cells, strict=True))


CASES = [pytest.param(*row, id=" ".join(row[0])) for row in rows()]
FAULTS = [
    SafetyStatus(SafetyLevel.WARNING, SafetyFlag.TX_QUEUE_OVERRUN, "can0"),
    SafetyStatus(SafetyLevel.FAULT, SafetyFlag.RX_TIMEOUT, "can1", "left_elbow is silent"),
    SafetyStatus(SafetyLevel.CRITICAL, SafetyFlag.NONE, "imu"),
]


def reached(words):
    return Run().reach(NAMES[words[0]], finished="finished" in words)


@pytest.mark.parametrize(("words", "cells"), CASES)
def test_every_intent(words, cells):
    run = reached(words)
    before = NAMES[words[0]]
    for name, cell in cells.items():
        _, output = step(run.stack, run.memory, run.input(Intent[name]))
        control = output.control_mode
        assert control.controller_name == NAMES.get(cell, before), name
        assert control.mode.name == MODES[control.controller_name]
        assert output.quit == (cell == "quit"), name
        assert is_complete(output.command)
        assert cell != "damping" or is_damping(output)
        refusal = f"{name} refused"
        assert (refusal in control.status_message) == (cell == "-"), control.status_message
        if cell == "-":
            required = REQUIRED[name]
            is_now = before if "STANDBY" in required and MODES[before] == "STANDBY" else MODES[before]
            for word in (*required, is_now):
                assert word in control.status_message


@pytest.mark.parametrize("fault", FAULTS, ids=lambda status: status.level.name)
@pytest.mark.parametrize(("words", "cells"), CASES)
def test_a_status_that_is_not_ok_damps_in_that_tick_and_refuses_all_but_damp_and_quit(words, cells, fault):
    run = reached(words)
    before = NAMES[words[0]]
    for intent in (None, *Intent):
        given = run.input(*[intent] if intent else [], safety=(SafetyStatus(), fault))
        _, output = step(run.stack, run.memory, given)
        stays = before == ZERO and intent is not Intent.DAMP
        assert output.control_mode.controller_name == (ZERO if stays else DAMPING), intent
        assert stays or is_damping(output)
        is_quit = intent is Intent.QUIT and before in (ZERO, DAMPING)
        assert output.quit == is_quit
        if intent not in (None, Intent.DAMP) and not is_quit:
            assert f"{intent.name} refused" in output.control_mode.status_message
        if before not in (ZERO, DAMPING):
            for word in (fault.level.name, fault.source, fault.message):
                assert word in output.control_mode.status_message


@pytest.mark.parametrize("controller", [A, RL, REMOTE])
def test_nothing_recovers_by_itself(controller):
    run = Run().reach(controller)
    assert is_damping(run.step(safety=(FAULTS[0],)))
    assert all(is_damping(run.step()) for _ in range(100))
    assert run.step(Intent.LOAD_A).control_mode.controller_name == A, "an operator may begin again"


@pytest.mark.parametrize(
    ("before", "intents", "after", "is_quit"),
    [
        (DAMPING, (Intent.LOAD_A, Intent.QUIT, Intent.DAMP, Intent.LOAD_A), DAMPING, False),
        (DAMPING, (Intent.LOAD_A, Intent.LOAD_B, Intent.QUIT), DAMPING, True),
        (DAMPING, (Intent.LOAD_B, Intent.LOAD_A, Intent.START_REMOTE), B, False),
        (A, (Intent.START_REMOTE, Intent.START_LOCOMOTION), REMOTE, False),
        (RL, (Intent.START_REMOTE, Intent.QUIT, Intent.DAMP), DAMPING, False),
        (ZERO, (Intent.QUIT, Intent.DAMP), DAMPING, False),
    ],
)
def test_of_several_intents_damp_counts_then_quit_then_the_first(before, intents, after, is_quit):
    output = Run().reach(before).step(*intents)
    assert output.control_mode.controller_name == after
    assert output.quit == is_quit
    counts = Intent.DAMP if Intent.DAMP in intents else Intent.QUIT if Intent.QUIT in intents else intents[0]
    for intent in {*intents} - {counts}:
        assert f"{intent.name} refused" in output.control_mode.status_message


def test_it_starts_in_zero_torque():
    output = Run().step()
    assert (output.control_mode.mode.name, output.control_mode.controller_name) == ("ZERO_TORQUE", ZERO)
    assert bits(output.command) == [bytes(3 * 8)] * 5


def test_damping_brakes_every_joint_where_it_is():
    output = Run().reach(A).step(Intent.DAMP)
    assert is_damping(output)
    assert output.command.position.tolist() == list(MEASURED.values())


@pytest.mark.parametrize("controller", PATHS)
def test_a_step_is_a_function_of_its_arguments(controller):
    run = Run().reach(controller)
    for intents in ((), (Intent.DAMP,), (Intent.START_LOCOMOTION, Intent.LOAD_A)):
        (_, first), (_, second) = (step(run.stack, run.memory, run.input(*intents)) for _ in range(2))
        assert bits(first.command) == bits(second.command)
        assert first.control_mode == second.control_mode
