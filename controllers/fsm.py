"""The five-mode state machine: a pure function from the present mode, safety and an intent to the next controller."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

from humanoid_sim.controllers.base import DAMPING, REMOTE_POLICY, RL_POLICY, STANDBY_A, STANDBY_B, ZERO_TORQUE
from humanoid_sim.messages import OK, Intent, Mode, SafetyFlag, SafetyStatus

MODES: Mapping[str, Mode] = {
    ZERO_TORQUE: Mode.ZERO_TORQUE,
    DAMPING: Mode.DAMPING,
    STANDBY_A: Mode.STANDBY,
    STANDBY_B: Mode.STANDBY,
    RL_POLICY: Mode.LOCOMOTION,
    REMOTE_POLICY: Mode.REMOTE,
}
"""Mode of each controller."""
MOVING = frozenset({Mode.STANDBY, Mode.LOCOMOTION, Mode.REMOTE})
"""Modes that drive the joints: safety and guards end them in DAMPING."""
RESTING = frozenset({Mode.ZERO_TORQUE, Mode.DAMPING})  # modes in which nothing pushes a joint


@dataclass(frozen=True, slots=True)
class Rule:
    """Modes from which an intent is granted, and the controller that it leads to, None for quit."""

    modes: frozenset[Mode]
    target: str | None
    standby_finished: bool = False  # True if the standby controller must have arrived


RULES: Mapping[Intent, Rule] = {
    Intent.DAMP: Rule(frozenset(Mode), DAMPING),
    Intent.LOAD_A: Rule(frozenset({Mode.DAMPING}), STANDBY_A),
    Intent.LOAD_B: Rule(frozenset({Mode.DAMPING}), STANDBY_B),
    Intent.START_LOCOMOTION: Rule(frozenset({Mode.STANDBY}), RL_POLICY, standby_finished=True),
    Intent.START_REMOTE: Rule(frozenset({Mode.STANDBY}), REMOTE_POLICY, standby_finished=True),
    Intent.QUIT: Rule(RESTING, None),
}


@dataclass(frozen=True, slots=True)
class Decision:
    """The controller to activate, None for none, and the reasons for that and for refusing an intent."""

    controller: str | None = None
    quit: bool = False
    message: str = ""
    refusal: str = ""


def mode_names(modes: frozenset[Mode]) -> str:
    """Return the names of some modes, such as `ZERO_TORQUE or DAMPING`."""
    return " or ".join(mode.name for mode in sorted(modes))


def merge_safety(statuses: Sequence[SafetyStatus]) -> SafetyStatus:
    """Return all sources as one: the highest level, flags or-ed, sources and messages of those that are not OK."""
    if all(status.is_ok and not status.flags for status in statuses):
        return OK
    flags = SafetyFlag.NONE
    for status in statuses:
        flags |= status.flags
    bad = [status for status in statuses if not status.is_ok]
    source = ", ".join(dict.fromkeys(status.source for status in bad if status.source))
    message = "; ".join(dict.fromkeys(status.message for status in bad if status.message))
    return SafetyStatus(max(status.level for status in statuses), flags, source, message)


def describe_safety(safety: SafetyStatus) -> str:
    """Return one line for an operator: `safety FAULT MOTOR_FAULT from can0: left_elbow_pitch over-current`."""
    flags = (safety.flags.name or hex(safety.flags)) if safety.flags else ""  # another source's bits may have no name
    origin = f"from {safety.source}" if safety.source else ""
    line = " ".join(word for word in ("safety", safety.level.name, flags, origin) if word)
    return f"{line}: {safety.message}" if safety.message else line


def choose_intent(intents: Sequence[Intent]) -> tuple[Intent | None, tuple[Intent, ...]]:
    """Return the one intent of a tick that counts, and the others: DAMP wins, then QUIT, then the first."""
    if not intents:
        return None, ()
    chosen = next((wanted for wanted in (Intent.DAMP, Intent.QUIT) if wanted in intents), intents[0])
    return chosen, tuple(dict.fromkeys(intent for intent in intents if intent is not chosen))


def refused(intent: Intent, reason: str) -> str:
    """Return the line that refuses an intent."""
    return f"{intent.name} refused: {reason}"


def transition(
    current: str,
    safety: SafetyStatus,
    intent: Intent | None,
    standby_finished: bool,
    available: Container[str],
    unready: str = "",
) -> Decision:
    """Return the next controller: `RULES`, after safety, which is all sources merged.

    Any status but OK moves STANDBY, LOCOMOTION and REMOTE to DAMPING and refuses every intent but DAMP and QUIT while
    it lasts. It never moves ZERO_TORQUE up, and nothing recovers by itself. `available` has the names of the
    controllers that exist, `unready` is why the one that is to move the robot cannot start yet; '' for none.
    """
    refusal = ""
    if intent is not None:
        reason = why_refused(current, safety, intent, standby_finished, available) or unready
        refusal = refused(intent, reason) if reason else ""
    if MODES[current] in MOVING and not safety.is_ok:
        return Decision(DAMPING, message=describe_safety(safety), refusal=refusal)
    if intent is None or refusal or RULES[intent].target == current:  # the last is DAMP in DAMPING
        return Decision(refusal=refusal)
    target = RULES[intent].target
    return Decision(target, quit=target is None, message=f"{intent.name} requested")


def why_refused(
    current: str, safety: SafetyStatus, intent: Intent, standby_finished: bool, available: Container[str]
) -> str:
    """Return why `transition` would refuse an intent; '' for one that it grants. Arguments as there."""
    rule, mode = RULES[intent], MODES[current]
    requirement = ("finished " if rule.standby_finished else "") + mode_names(rule.modes)
    if not safety.is_ok and intent not in (Intent.DAMP, Intent.QUIT):
        return describe_safety(safety)
    if mode not in rule.modes:
        return f"requires {requirement}, mode is {mode.name}"
    if rule.standby_finished and not standby_finished:
        return f"requires {requirement}, {current} has not finished"
    if rule.target is not None and rule.target not in available:
        return f"{rule.target} is not available"
    return ""
