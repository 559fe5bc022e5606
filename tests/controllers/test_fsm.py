"""The state machine, exhaustively: every controller, safety status, intent, standby progress and set of controllers."""

import re
from itertools import chain, combinations, permutations, product

import pytest

from humanoid_sim.controllers import fsm
from humanoid_sim.messages import OK, Intent, Mode, SafetyFlag, SafetyLevel, SafetyStatus

ZERO = "zero_torque_controller"
DAMPING = "damping_controller"
A = "standby_controller_a"
B = "standby_controller_b"
RL = "rl_policy_controller"
REMOTE = "remote_policy_controller"
CONTROLLERS = (ZERO, DAMPING, A, B, RL, REMOTE)
MODE = {ZERO: "ZERO_TORQUE", DAMPING: "DAMPING", A: "STANDBY", B: "STANDBY", RL: "LOCOMOTION", REMOTE: "REMOTE"}

STAY, NO, QUIT = "stay", "refused", "quit"

SAFE_TABLE = """
             none  damp     load_a   load_b   start_locomotion  start_remote  quit
zero         stay  damping  refused  refused  refused           refused       quit
damping      stay  stay     a        b        refused           refused       quit
a            stay  damping  refused  refused  refused           refused       refused
a finished   stay  damping  refused  refused  rl                remote        refused
b            stay  damping  refused  refused  refused           refused       refused
b finished   stay  damping  refused  refused  rl                remote        refused
rl           stay  damping  refused  refused  refused           refused       refused
remote       stay  damping  refused  refused  refused           refused       refused
"""
"""With every source OK and every controller available: who is in control next."""

UNSAFE_TABLE = """
             none     damp     load_a   load_b   start_locomotion  start_remote  quit
zero         stay     damping  refused  refused  refused           refused       quit
damping      stay     stay     refused  refused  refused           refused       quit
a            damping  damping  damping  damping  damping           damping       damping
b            damping  damping  damping  damping  damping           damping       damping
rl           damping  damping  damping  damping  damping           damping       damping
remote       damping  damping  damping  damping  damping           damping       damping
"""
"""With any source not OK."""

NAMES = {"zero": ZERO, "damping": DAMPING, "a": A, "b": B, "rl": RL, "remote": REMOTE}


def parse(table):
    header, *rows = table.strip().splitlines()
    cells = {}
    for row in rows:
        name, finished, rest = re.fullmatch(r"(\w+)( finished)?\s+(.*)", row).groups()
        for intent, cell in zip(header.split(), rest.split(), strict=True):
            cells[NAMES[name], bool(finished), intent] = NAMES.get(cell, cell)
    return cells


SAFE, UNSAFE = parse(SAFE_TABLE), parse(UNSAFE_TABLE)
INTENTS = (None, *Intent)
STATUSES = [
    SafetyStatus(level, flags) for level, flags in product(SafetyLevel, (SafetyFlag.NONE, SafetyFlag.BUS_OFF, 1 << 31))
]
SUBSETS = [frozenset(chosen) for chosen in chain.from_iterable(combinations(CONTROLLERS, size) for size in range(7))]


def expected(current, status, intent, finished):
    word = "none" if intent is None else intent.value
    table = SAFE if status.level == 0 else UNSAFE
    return table.get((current, finished, word)) or table[current, False, word]


def test_modes_of_the_controllers():
    assert {name: mode.name for name, mode in fsm.MODES.items()} == MODE
    assert set(fsm.MODES.values()) == set(Mode)  # enough for the wire


@pytest.mark.parametrize("current", CONTROLLERS)
def test_every_decision_with_every_controller_available(current):
    for status, intent, finished in product(STATUSES, INTENTS, (False, True)):
        decision = fsm.transition(current, status, intent, finished, CONTROLLERS)
        cell = expected(current, status, intent, finished)
        where = (current, status, intent, finished)
        assert decision.quit == (cell == QUIT), where
        assert decision.controller == (None if cell in (STAY, NO, QUIT) else cell), where
        if cell == NO:
            assert decision.refusal.startswith(f"{intent.name} refused: "), where
            assert not decision.message, where
        if cell in CONTROLLERS:
            assert decision.message, where


@pytest.mark.parametrize("current", CONTROLLERS)
def test_safety_properties_for_every_set_of_available_controllers(current):
    count = 0
    for status, intent, finished, available in product(STATUSES, INTENTS, (False, True), SUBSETS):
        decision = fsm.transition(current, status, intent, finished, available)
        where = (current, status, intent, finished, available)
        count += 1
        target = decision.controller or current
        unsafe = status.level != 0
        moved = target != current

        assert decision.controller in (None, ZERO, *available), where
        if intent is Intent.DAMP:
            assert target == (DAMPING if DAMPING in available else ZERO), where
            assert DAMPING in available or f"{DAMPING} is not available" in decision.message, where
            assert not decision.refusal, where
        if unsafe:
            assert target in (ZERO, DAMPING), where
        if moved and target in (RL, REMOTE):
            assert current in (A, B), where
            assert finished, where
            assert intent is {RL: Intent.START_LOCOMOTION, REMOTE: Intent.START_REMOTE}[target], where
        if moved and target in (A, B):
            assert current == DAMPING, where
            assert intent is {A: Intent.LOAD_A, B: Intent.LOAD_B}[target], where
        if current in (ZERO, DAMPING) and intent is None:
            assert decision == fsm.Decision(), where
        if current == ZERO:
            assert target == ZERO or intent is Intent.DAMP, where
        if decision.quit:
            assert intent is Intent.QUIT, where
            assert current in (ZERO, DAMPING), where
            assert not moved, where
        if moved or decision.quit:
            assert decision.message, where
        if intent is not None and not decision.quit and not moved and (current, intent) != (DAMPING, Intent.DAMP):
            gone = current == ZERO and intent is Intent.DAMP and DAMPING not in available
            assert gone or decision.refusal.startswith(f"{intent.name} refused: "), where
        if intent is None:
            assert not decision.refusal, where
    assert count == 12 * 7 * 2 * 64


def test_availability_only_ever_takes_away():
    """With fewer controllers a decision is the full one, a refusal by name, or ZERO_TORQUE for a missing DAMPING."""
    refused = 0
    for current, *asked in product(CONTROLLERS, STATUSES, INTENTS, (False, True)):
        intent = asked[1]
        full = fsm.transition(current, *asked, CONTROLLERS)
        for available in SUBSETS:
            decision = fsm.transition(current, *asked, available)
            if full.controller is None or full.controller in available:
                if not (current == DAMPING and intent is Intent.DAMP and DAMPING not in available):
                    assert decision == full
            elif full.controller == DAMPING:
                assert decision.controller == ZERO
                assert decision.refusal == full.refusal
            else:
                refused += 1
                assert decision == fsm.Decision(refusal=f"{intent.name} refused: {full.controller} is not available")
    assert refused == (2 + 4) * 3 * 32 + 2 * 3 * 32  # LOADs, and STARTs from each finished pose, times OK flags


FAULT = SafetyStatus(2, SafetyFlag.MOTOR_FAULT, "can0", "left_elbow over-current")
OVERRUN = SafetyStatus(1, SafetyFlag.TX_QUEUE_OVERRUN, "can1")
AT_REST, POSED = "requires ZERO_TORQUE or DAMPING, mode is", "requires finished STANDBY,"


@pytest.mark.parametrize(
    ("current", "status", "intent", "finished", "missing", "why"),
    [
        (A, OK, Intent.LOAD_A, False, None, "requires DAMPING, mode is STANDBY"),
        (A, OK, Intent.LOAD_B, True, None, "requires DAMPING, mode is STANDBY"),
        (ZERO, OK, Intent.LOAD_B, False, None, "requires DAMPING, mode is ZERO_TORQUE"),
        (RL, OK, Intent.QUIT, False, None, f"{AT_REST} LOCOMOTION"),
        (DAMPING, OK, Intent.START_REMOTE, True, None, f"{POSED} mode is DAMPING"),
        (B, OK, Intent.START_LOCOMOTION, False, None, f"{POSED} standby_controller_b has not finished"),
        (A, OK, Intent.START_LOCOMOTION, True, RL, "rl_policy_controller is not available"),
        (DAMPING, FAULT, Intent.LOAD_A, False, None, "safety FAULT MOTOR_FAULT from can0: left_elbow over-current"),
        (REMOTE, OVERRUN, Intent.QUIT, False, None, f"{AT_REST} REMOTE"),
    ],
)
def test_refusal_texts(current, status, intent, finished, missing, why):
    available = set(CONTROLLERS) - {missing}
    assert fsm.transition(current, status, intent, finished, available).refusal == f"{intent.name} refused: {why}"


@pytest.mark.parametrize(
    ("current", "status", "intent", "available", "text"),
    [
        (ZERO, OK, Intent.DAMP, CONTROLLERS, "DAMP requested"),
        (DAMPING, OK, Intent.LOAD_B, CONTROLLERS, "LOAD_B requested"),
        (DAMPING, OK, Intent.QUIT, CONTROLLERS, "QUIT requested"),
        (RL, SafetyStatus(3, 0, "can0"), None, CONTROLLERS, "safety CRITICAL from can0"),
        (ZERO, OK, Intent.DAMP, (ZERO,), "DAMP requested; damping_controller is not available"),
        (A, SafetyStatus(1), None, (ZERO, A), "safety WARNING; damping_controller is not available"),
    ],
)
def test_reasons(current, status, intent, available, text):
    assert fsm.transition(current, status, intent, False, available).message == text


def test_choose_intent_over_every_order_of_every_set():
    count = 0
    for size in range(7):
        for intents in permutations(Intent, size):
            chosen, others = fsm.choose_intent(intents)
            count += 1
            if Intent.DAMP in intents:
                assert chosen is Intent.DAMP
            elif Intent.QUIT in intents:
                assert chosen is Intent.QUIT
            else:
                assert chosen is (intents[0] if intents else None)
            assert others == tuple(intent for intent in intents if intent is not chosen)
            assert fsm.choose_intent(intents * 2) == (chosen, others), "repetitions count once"
    assert count == 1957


def test_merge_safety_of_nothing_and_of_every_pair():
    assert fsm.merge_safety(()) == SafetyStatus(0, 0, "", "")
    for first, second in product(STATUSES, STATUSES):
        merged = fsm.merge_safety([first, second])
        assert merged.level == max(first.level.value, second.level.value)
        assert merged.flags.value == first.flags.value | second.flags.value
        assert merged == fsm.merge_safety([second, first])
        assert fsm.merge_safety([first]) == first


def test_merge_safety_names_only_what_is_wrong():
    down = SafetyStatus(2, SafetyFlag.BUS_OFF, "can1", "bus is down")
    late = SafetyStatus(1, SafetyFlag.TX_QUEUE_OVERRUN, "can0", "queue overflowed")
    merged = fsm.merge_safety([SafetyStatus(0, 0, "simulator", "all well"), late, down, down])
    flags = SafetyFlag.TX_QUEUE_OVERRUN | SafetyFlag.BUS_OFF
    assert merged == SafetyStatus(SafetyLevel.FAULT, flags, "can0, can1", "queue overflowed; bus is down")


@pytest.mark.parametrize(
    ("status", "line"),
    [
        (SafetyStatus(1), "safety WARNING"),
        (SafetyStatus(3, 0b11, "can0", "cable"), "safety CRITICAL BUS_OFF|RX_TIMEOUT from can0: cable"),
        (SafetyStatus(2, 0x41), "safety FAULT BUS_OFF|0x40"),
        (SafetyStatus(2, 0x80000000, "plugin"), "safety FAULT 0x80000000 from plugin"),
        (SafetyStatus(2, 0, "", "no reason given"), "safety FAULT: no reason given"),
    ],
)
def test_describe_safety(status, line):
    assert fsm.describe_safety(status) == line


def test_the_intent_that_took_effect_is_the_chosen_one_unless_it_was_refused_too():
    assert fsm.granted_intent((), ()) is None
    assert fsm.granted_intent((Intent.LOAD_A,), ()) is Intent.LOAD_A
    assert fsm.granted_intent((Intent.LOAD_A,), ("LOAD_A refused",)) is None
    assert fsm.granted_intent((Intent.LOAD_A, Intent.DAMP), ("LOAD_A refused",)) is Intent.DAMP


@pytest.mark.parametrize(
    ("current", "finished", "expected"),
    [
        ("zero_torque_controller", False, {Intent.DAMP, Intent.QUIT}),
        ("damping_controller", False, {Intent.DAMP, Intent.LOAD_A, Intent.LOAD_B, Intent.QUIT}),
        ("standby_controller_b", False, {Intent.DAMP}),
        ("standby_controller_b", True, {Intent.DAMP, Intent.START_LOCOMOTION, Intent.START_REMOTE}),
        ("rl_policy_controller", False, {Intent.DAMP}),
    ],
)
def test_granted_intents_are_those_that_are_not_refused(current, finished, expected):
    assert set(fsm.granted(current, OK, finished, set(fsm.MODES))) == expected
    without = set(fsm.MODES) - {"remote_policy_controller"}
    assert set(fsm.granted(current, OK, finished, without)) == expected - {Intent.START_REMOTE}
    unsafe = SafetyStatus(SafetyLevel.FAULT)
    assert set(fsm.granted(current, unsafe, finished, set(fsm.MODES))) == expected & {Intent.DAMP, Intent.QUIT}
