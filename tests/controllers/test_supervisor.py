"""The supervisor: construction, containment of failures, and its state space exhausted over abstract inputs."""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar

import numpy as np
import pytest
from rig import (
    BAD_ANSWERS,
    DAMPING_KD,
    JOINTS,
    KNOWN,
    PATHS,
    RigProperties,
    Run,
    command,
    good_answer,
    state,
    supervisor,
)

from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.damping import DampingController, ZeroTorqueController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyStatus, TickInput
from humanoid_sim.mit import MITCommand
from humanoid_sim.testing import ScriptedPolicy, fingerprint
from humanoid_sim.testing.properties import DAMPING, MODE_NUMBER, REMOTE, RL, ZERO
from humanoid_sim.testing.properties import STANDBY_A as A
from humanoid_sim.testing.properties import STANDBY_B as B

NAN, INF = np.nan, np.inf
UNKNOWN = (NAN, NAN, NAN)
FAULT = (SafetyStatus(2, 8, "can0", "over-current"),)


def test_the_start_is_zero_torque():
    output = Run(supervisor()).step()
    assert output.control_mode.controller_name == ZERO
    assert output.control_mode.status_message == "started"
    assert fingerprint(output.command) == fingerprint(MITCommand.zeros(3))
    assert not output.quit


@pytest.mark.parametrize("name", PATHS)
def test_the_way_to_every_controller(name):
    output = Run(supervisor()).walk(*PATHS[name])
    assert output.control_mode.controller_name == name
    assert output.control_mode.mode == MODE_NUMBER[name] == {ZERO: 0, DAMPING: 1, A: 2, B: 2, RL: 3, REMOTE: 4}[name]
    assert output.faults == ()
    assert output.refusals == ()


def test_a_whole_run_tick_by_tick():
    run = Run(supervisor())
    script = [(), (Intent.DAMP,), (), (Intent.LOAD_A,), (), (Intent.START_LOCOMOTION,), (), (), (Intent.START_REMOTE,)]
    script += [(), (Intent.DAMP,), (Intent.QUIT,)]
    seen = [run.step(*intents) for intents in script]
    assert [output.control_mode.mode.name for output in seen] == [
        "ZERO_TORQUE", "DAMPING", "DAMPING", "STANDBY", "STANDBY", "STANDBY", "STANDBY", "STANDBY", "REMOTE",
        "REMOTE", "DAMPING", "DAMPING",
    ]  # fmt: skip
    assert [output.quit for output in seen] == [False] * 11 + [True]
    assert seen[5].control_mode.status_message == (
        "START_LOCOMOTION refused: requires finished STANDBY, standby_controller_a has not finished"
    )
    assert seen[7].standby.is_finished
    assert seen[8].control_mode.status_message == "START_REMOTE requested"


@pytest.mark.parametrize(("age", "granted"), [(None, False), (0.11, False), (-5.0, False), (0.09, True), (0.0, True)])
def test_a_robot_that_must_be_balanced_starts_remote_only_with_commands_that_arrive(age, granted):
    run = Run(replace(supervisor(), needs_producer=True))
    run.walk(Intent.DAMP, Intent.LOAD_A)
    output = run.step(Intent.START_REMOTE, remote=None if age is None else RemoteCommand(command(), run.time - age))
    assert output.control_mode.mode is (Mode.REMOTE if granted else Mode.STANDBY)
    silence = "START_REMOTE refused: no remote command within the last 100 ms, and nothing else keeps a floating base"
    assert [text.startswith(silence) for text in output.refusals] == ([] if granted else [True])


def test_the_latest_word_stays_until_there_is_another():
    run = Run(supervisor())
    words = [run.step(*intents).control_mode.status_message for intents in ((Intent.LOAD_A,), (), (Intent.DAMP,), ())]
    refused = "LOAD_A refused: requires DAMPING, mode is ZERO_TORQUE"
    assert words == [refused, refused, "DAMP requested", "DAMP requested"]
    output = Run(supervisor()).step(Intent.LOAD_A, Intent.QUIT, Intent.DAMP, Intent.LOAD_A)
    assert output.control_mode.controller_name == DAMPING
    assert not output.quit
    assert output.refusals == ("LOAD_A refused: DAMP came in the same tick", "QUIT refused: DAMP came in the same tick")


def test_the_tick_of_a_transition_carries_the_new_controllers_command():
    run = Run(supervisor())
    run.step()
    assert run.step(Intent.DAMP).command.damping.tolist() == DAMPING_KD
    first = run.step(Intent.LOAD_A)
    assert first.command.stiffness.tolist() == [0.0, 0.0, 0.0]
    assert first.command.position.tolist() == list(KNOWN)
    assert first.standby.progress == 0.0


def test_safety_demotes_in_the_same_tick_and_nothing_recovers_by_itself():
    run = Run(supervisor())
    run.walk(*PATHS[RL])
    demoted = run.step(safety=(SafetyStatus(), *FAULT))
    assert demoted.control_mode.controller_name == DAMPING
    assert demoted.control_mode.status_message == "safety FAULT MOTOR_FAULT from can0: over-current"
    assert demoted.command.damping.tolist() == DAMPING_KD
    refused = run.step(Intent.LOAD_A, safety=FAULT)
    assert refused.refusals == ("LOAD_A refused: safety FAULT MOTOR_FAULT from can0: over-current",)
    assert [run.step().control_mode.controller_name for _ in range(50)] == [DAMPING] * 50
    assert run.step(Intent.LOAD_A).control_mode.controller_name == A


@pytest.mark.parametrize("name", BAD_ANSWERS)
def test_a_misbehaving_policy_is_damped_in_the_same_tick(name):
    policy = ScriptedPolicy(good_answer)
    run = Run(supervisor(policy))
    run.walk(*PATHS[RL])
    policy.answer = BAD_ANSWERS[name]
    run.step()
    output = run.step()
    assert output.control_mode.controller_name == DAMPING
    assert output.command.damping.tolist() == DAMPING_KD
    assert output.command.stiffness.tolist() == [0.0, 0.0, 0.0]
    (fault,) = output.faults
    assert (fault.controller, fault.fallback, fault.is_bug) == (RL, DAMPING, False)
    assert output.control_mode.status_message.startswith(f"{RL} failed: ")
    assert run.step().faults == ()


def test_the_whole_chain_in_one_tick():
    run = Run(supervisor())
    run.walk(*PATHS[REMOTE])
    bad = RemoteCommand(command(stiffness=[NAN, 0.0, 0.0]), run.time)
    output = run.step(position=UNKNOWN, remote=bad)
    assert output.control_mode.controller_name == ZERO
    assert [(fault.controller, fault.fallback) for fault in output.faults] == [(REMOTE, DAMPING), (DAMPING, ZERO)]
    assert fingerprint(output.command) == fingerprint(MITCommand.zeros(3))
    assert output.control_mode.status_message == (
        "remote_policy_controller failed: remote command's stiffness of shoulder is nan, "
        "expected a finite number from 0 to 1e+06; damping_controller takes over; "
        "damping_controller failed: no joint position is known; "
        "zero_torque_controller takes over"
    )


def test_damp_without_a_known_joint_is_zero_torque_with_a_reason():
    output = Run(supervisor()).step(Intent.DAMP, position=UNKNOWN)
    assert output.control_mode.controller_name == ZERO
    assert output.control_mode.status_message == (
        "DAMP requested; damping_controller failed: no joint position is known; zero_torque_controller takes over"
    )


def test_damping_goes_on_where_a_load_fails():
    """DAMPING needs no state once it is active; a LOAD that cannot start must not make the robot limp."""
    run = Run(supervisor())
    run.step(Intent.DAMP)
    output = run.step(Intent.LOAD_A, position=UNKNOWN)
    assert output.control_mode.controller_name == DAMPING
    assert output.command.position.tolist() == list(KNOWN)
    assert output.command.damping.tolist() == DAMPING_KD
    assert [(fault.controller, fault.fallback) for fault in output.faults] == [(A, DAMPING)]
    run = Run(supervisor())
    run.walk(*PATHS[A])
    output = run.step(position=(0.1, NAN, 0.3))
    assert output.control_mode.controller_name == DAMPING, "one silent joint leaves the others damped"
    assert output.command.position.tolist() == [0.1, 0.0, 0.3]
    assert output.command.damping.tolist() == DAMPING_KD


@dataclass(frozen=True, eq=False)
class Foreign:
    """A controller from outside the package, which does whatever `behaviour` does."""

    fallback: ClassVar[str | None] = DAMPING
    behaviour: Any
    activation: Any = lambda *_: Memory()
    joints: tuple[str, ...] = JOINTS

    def activate(self, given):
        return self.activation(given)

    def update(self, memory, given):
        return self.behaviour(memory, given)


def explode(*_):
    raise KeyError("gains")


class Sham(MITCommand):
    """A command that calls itself finite."""

    def is_finite(self):
        return True


class Treacherous:
    """A memory that cannot be asked."""

    @property
    def policy_step(self):
        raise RuntimeError("no")


class UnprintableError(Exception):
    def __str__(self):
        raise ValueError("not even this")


def explode_unprintably(*_):
    raise UnprintableError


def gives(**values):
    return lambda memory, *_: (memory, command(**values))


@pytest.mark.parametrize(
    ("behaviour", "message", "is_bug"),
    [
        (explode, "KeyError: 'gains'", True),
        (lambda *_: None, "TypeError: ", True),
        (lambda memory, *_: (memory, None), "TypeError: update gave a NoneType, expected an MITCommand", True),
        (lambda memory, *_: (memory, "damp"), "TypeError: update gave a str, expected an MITCommand", True),
        (lambda memory, *_: (memory, Sham(*[np.full(3, NAN)] * 5)), "TypeError: update gave a Sham", True),
        (lambda memory, *_: (memory, MITCommand.zeros(3), 1), "ValueError: ", True),
        (lambda *_: (None, MITCommand.zeros(3)), "TypeError: update gave NoneType for a memory", True),
        (lambda *_: (Fault("x"), MITCommand.zeros(3)), "TypeError: update gave Fault for a memory", True),
        (lambda *_: (Treacherous(), MITCommand.zeros(3)), "RuntimeError: no", True),
        (explode_unprintably, "Unprintable", True),
        (lambda *_: Fault(None), "None", False),
        (lambda *_: Fault("\ud800"), "\\ud800", False),
        (lambda memory, *_: (memory, MITCommand.zeros(2)), "command has shape (2,), expected (3,)", False),
        (lambda memory, *_: (memory, MITCommand.zeros(1, 3)), "command has shape (1, 3), expected (3,)", False),
        (gives(damping=[1.0, NAN, 1.0]), "command's damping of elbow is nan, expected a finite number", False),
        (gives(stiffness=[1.0, 1.0, -2.0]), "command's stiffness of wrist is -2.0, expected a finite number", False),
        (gives(position=[INF, 1.0, 1.0]), "command's position of shoulder is inf, expected a finite number", False),
        (lambda *_: Fault("tired"), "tired", False),
    ],
)
def test_what_a_foreign_controller_does_never_leaves(behaviour, message, is_bug):
    run = Run(supervisor(**{A: Foreign(behaviour)}))
    run.step(Intent.DAMP)
    output = run.step(Intent.LOAD_A)
    assert output.control_mode.controller_name == DAMPING
    assert output.command.damping.tolist() == DAMPING_KD
    (fault,) = output.faults
    assert fault.message.startswith(message)
    assert fault.is_bug == is_bug
    assert f"{A} {'raised' if is_bug else 'failed'}: " in output.control_mode.status_message


@pytest.mark.parametrize("activation", [explode, lambda *_: Fault("cold")])
def test_a_failing_activation_is_contained(activation):
    run = Run(supervisor(**{B: Foreign(explode, activation)}))
    run.step(Intent.DAMP)
    output = run.step(Intent.LOAD_B)
    assert output.control_mode.controller_name == DAMPING
    assert output.faults[0].is_bug == (activation is explode)


def test_a_bug_in_damping_leads_to_zero_torque_and_one_in_that_leaves_zeros():
    run = Run(supervisor(**{DAMPING: type("Broken", (Foreign,), {"fallback": ZERO})(explode)}))
    output = run.step(Intent.DAMP)
    assert output.control_mode.controller_name == ZERO
    assert output.faults[0].is_bug
    run = Run(supervisor(**{ZERO: type("Broken", (Foreign,), {"fallback": None})(explode)}))
    for _ in range(2):
        output = run.step()
        assert output.control_mode.controller_name == ZERO
        assert fingerprint(output.command) == fingerprint(MITCommand.zeros(3))
        assert output.faults[0].is_bug


def test_keyboard_interrupts_are_not_swallowed():
    def interrupt(*_):
        raise KeyboardInterrupt

    run = Run(supervisor(interrupt))
    run.walk(*PATHS[A])
    with pytest.raises(KeyboardInterrupt):
        run.step(Intent.START_LOCOMOTION)


@pytest.mark.parametrize(
    ("missing", "intent", "path"),
    [(RL, Intent.START_LOCOMOTION, A), (REMOTE, Intent.START_REMOTE, B), (B, Intent.LOAD_B, DAMPING)],
)
def test_a_controller_that_is_not_there_is_refused_by_name(missing, intent, path):
    run = Run(supervisor(**{missing: None}))
    run.walk(*PATHS[path])
    output = run.step(intent)
    assert output.control_mode.controller_name == path
    assert output.refusals == (f"{intent.name} refused: {missing} is not available",)


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({ZERO: None}, "Supervisor.controllers: zero_torque_controller is missing"),
        ({DAMPING: None}, "Supervisor.controllers: damping_controller is missing"),
        ({"dance_controller": ZeroTorqueController(JOINTS)}, "Supervisor.controllers: unknown controller 'dance_contr"),
        (
            {DAMPING: DampingController(("shoulder", "wrist", "elbow"))},
            r"Supervisor.controllers\['damping_controller'\]: joints are shoulder, wrist, elbow, expected shoul",
        ),
        (
            {A: type("Looping", (Foreign,), {"fallback": A})(explode)},
            r"Supervisor.controllers\['standby_controller_a'\]: fallbacks are standby_controller_a -> standby_contr",
        ),
        (
            {A: type("Lost", (Foreign,), {"fallback": "nobody"})(explode)},
            r"Supervisor.controllers\['standby_controller_a'\]: fallbacks are standby_controller_a -> nobody",
        ),
    ],
)
def test_a_stack_that_cannot_be_safe_is_refused(replaced, message):
    with pytest.raises(FieldError, match=f"^{message}"):
        supervisor(**replaced)


def test_joints_are_checked_and_the_controllers_cannot_be_exchanged_later():
    with pytest.raises(FieldError, match=r"^Supervisor\.joints: is empty"):
        Supervisor((), {})
    made = supervisor()
    with pytest.raises(TypeError):
        made.controllers[ZERO] = ZeroTorqueController(JOINTS)


POSITIONS = {"known": KNOWN, "one NaN": (0.4, NAN, 0.6), "all NaN": UNKNOWN, "all infinite": (INF, -INF, INF)}
PAIRS = [(), *((first,) for first in Intent), *product(Intent, Intent)]
STEP = 0.05
"""s between the ticks of the search: more than a standby segment of the rig takes."""
SAFETIES = [(), (SafetyStatus(1),), FAULT, (SafetyStatus(0, 1), SafetyStatus(3, 0, "can1"))]


def remotes(now):
    """Every kind of remote command at a time; the controller, if active, was activated more than 1 s before."""
    return {
        "none": None,
        "fresh": RemoteCommand(command(), now),
        "stale": RemoteCommand(command(), now - 0.2),
        "before activation": RemoteCommand(command(), now - 100.0),
        "future": RemoteCommand(command(), now + 1.0),
        "NaN stamp": RemoteCommand(command(), NAN),
        "broken": RemoteCommand(command(damping=[-1.0, 1.0, 1.0]), now),
        "wrong width": RemoteCommand(command(n=2), now),
    }


def abstract(memory):
    """What the exhaustive search tells apart: who is in control, and how far."""
    inner = memory.controller_memory
    if memory.controller in (A, B):
        return (
            memory.controller,
            "finished" if inner.standby.is_finished else f"segment {inner.standby.current_segment}",
        )
    if memory.controller == RL:
        return RL, "inference due" if inner.held_ticks == 2 else "holding"
    if memory.controller == REMOTE:
        return REMOTE, "passive" if inner.command is None else "has a command"
    return memory.controller, ""


def abstract_inputs(name, finished, time):
    """Policies and commands vary only where this tick may consult them; that keeps the product small."""
    states = {word: state(time, position, extern={}) for word, position in POSITIONS.items()}
    commands, nothing = remotes(time), {"none": None}
    for word, safety, intents in product(POSITIONS, SAFETIES, PAIRS):
        consulted = {*intents} if finished else set()
        answers = BAD_ANSWERS if name == RL or Intent.START_LOCOMOTION in consulted else {}
        variants = commands if name == REMOTE or Intent.START_REMOTE in consulted else nothing
        if len(intents) == 2 and word != "known":
            continue  # pairs are about priority, which does not look at the state
        for answer in ("good", *answers):
            for variant in variants.values() if answer == "good" else (None,):
                yield answer, TickInput(states[word], safety, intents, variant)


@pytest.fixture(scope="module")
def explored():
    """Breadth first from the start: every abstract state with every abstract input, the properties checked on each."""
    policy = ScriptedPolicy(good_answer)
    stack = supervisor(policy)
    start = stack.initial()
    nodes = {abstract(start): (start, RigProperties(stack), 10.0)}
    queue, edges, ticks = list(nodes), set(), 0
    while queue:
        key = queue.pop(0)
        memory, watched, time = nodes[key]
        for answer, given in abstract_inputs(key[0], key[1] == "finished", time):
            policy.answer = BAD_ANSWERS.get(answer, good_answer)
            after, output = stack.step(memory, given)
            properties = watched.copy()
            properties.check(given, output)
            ticks += 1
            target = abstract(after)
            edges.add((key, target))
            if target not in nodes:
                nodes[target] = (after, properties, time + (1.0 if target[0] == REMOTE else STEP))
                queue.append(target)
    return nodes, edges, ticks


def test_the_states_and_transitions_that_are_reached(explored):
    """Each tick that was explored was checked for safety."""
    nodes, edges, ticks = explored
    assert ticks > 10_000
    progress = {ZERO: [""], DAMPING: [""], RL: ["holding", "inference due"], REMOTE: ["passive", "has a command"]}
    progress |= {pose: ["segment 0", "segment 1", "finished"] for pose in (A, B)}
    assert set(nodes) == {(name, word) for name, words in progress.items() for word in words}
    assert {(source[0], target[0]) for source, target in edges if source[0] != target[0]} == {
        (ZERO, DAMPING),
        *product((DAMPING,), (A, B)),
        *product((A, B), (RL, REMOTE)),
        *product((A, B, RL, REMOTE), (DAMPING, ZERO)),
    }
    for pose in (A, B):
        left = {(source[1], target[0]) for source, target in edges if source[0] == pose}
        assert {progress for progress, name in left if name in (RL, REMOTE)} == {"finished"}


@pytest.mark.parametrize("path", [path for path in PATHS if path != "zero_torque_controller"])
def test_an_absurd_reading_ends_in_damping_not_in_zero_torque(path):
    """Of one joint, above what may be commanded: the other joints are as sound as before."""
    run = Run(supervisor())
    run.walk(*PATHS[path])
    output = run.step(Intent.DAMP, position=(0.4, 1e9, 0.6))
    assert output.control_mode.mode is Mode.DAMPING
    assert not output.faults
    assert output.command.damping.tolist() == DAMPING_KD
