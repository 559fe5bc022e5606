"""The five-mode state machine: one pure function from what is and what is asked to who is in control next."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from humanoid_sim.controllers.base import DAMPING, REMOTE_POLICY, RL_POLICY, STANDBY_A, STANDBY_B, ZERO_TORQUE
from humanoid_sim.messages import OK, Intent, Mode, SafetyFlag, SafetyStatus

MODES: Mapping[str, Mode] = MappingProxyType(
    {
        ZERO_TORQUE: Mode.ZERO_TORQUE,
        DAMPING: Mode.DAMPING,
        STANDBY_A: Mode.STANDBY,
        STANDBY_B: Mode.STANDBY,
        RL_POLICY: Mode.LOCOMOTION,
        REMOTE_POLICY: Mode.REMOTE,
    }
)
"""Mode of each controller."""


@dataclass(frozen=True, slots=True)
class Rule:
    """Conditions under which an intent is granted."""

    modes: frozenset[Mode]
    """Modes from which alone it is granted."""
    target: str | None
    """Controller that it leads to; None: quit."""
    standby_finished: bool = False
    """True if it is granted only once the standby controller has arrived."""

    @property
    def requirement(self) -> str:
        """Return what is required, in words: `ZERO_TORQUE or DAMPING`, `finished STANDBY`."""
        names = " or ".join(mode.name for mode in sorted(self.modes))
        return f"finished {names}" if self.standby_finished else names


_STANDBY = frozenset({Mode.STANDBY})
_DAMPING = frozenset({Mode.DAMPING})

RULES: Mapping[Intent, Rule] = MappingProxyType(
    {
        Intent.DAMP: Rule(frozenset(Mode), DAMPING),
        Intent.LOAD_A: Rule(_DAMPING, STANDBY_A),
        Intent.LOAD_B: Rule(_DAMPING, STANDBY_B),
        Intent.START_LOCOMOTION: Rule(_STANDBY, RL_POLICY, standby_finished=True),
        Intent.START_REMOTE: Rule(_STANDBY, REMOTE_POLICY, standby_finished=True),
        Intent.QUIT: Rule(frozenset({Mode.ZERO_TORQUE, Mode.DAMPING}), None),
    }
)

MOVING = frozenset({Mode.STANDBY, Mode.LOCOMOTION, Mode.REMOTE})
"""Modes that drive the joints: safety and guards end them in DAMPING."""
_ALWAYS_HEARD = frozenset({Intent.DAMP, Intent.QUIT})


@dataclass(frozen=True, slots=True)
class Decision:
    """Decision of `transition`."""

    controller: str | None = None
    """The controller to activate; None: the present one stays."""
    quit: bool = False
    message: str = ""
    """Reason for the change of control."""
    refusal: str = ""
    """Reason why the intent takes no effect."""


def merge_safety(statuses: Sequence[SafetyStatus]) -> SafetyStatus:
    """All sources as one: the highest level, flags or-ed, sources and messages of whatever is not OK."""
    if all(status.is_ok and not status.flags for status in statuses):
        return OK
    level = max(status.level for status in statuses)
    flags = SafetyFlag.NONE
    for status in statuses:
        flags |= status.flags
    bad = [status for status in statuses if not status.is_ok]
    source = ", ".join(dict.fromkeys(status.source for status in bad if status.source))
    message = "; ".join(dict.fromkeys(status.message for status in bad if status.message))
    return SafetyStatus(level, flags, source, message)


def describe_safety(safety: SafetyStatus) -> str:
    """One line for an operator: `safety FAULT MOTOR_FAULT from can0: left_elbow_pitch over-current`."""
    words = ["safety", safety.level.name]
    if safety.flags:
        # Iterating over flags gives the bits that have a name; a plugin may set others.
        names = [flag.name or "" for flag in safety.flags]
        unnamed = int(safety.flags) & ~sum(int(flag) for flag in SafetyFlag)
        words.append("|".join([*names, hex(unnamed)] if unnamed else names))
    if safety.source:
        words += ["from", safety.source]
    line = " ".join(words)
    return f"{line}: {safety.message}" if safety.message else line


def choose_intent(intents: Sequence[Intent]) -> tuple[Intent | None, tuple[Intent, ...]]:
    """Return the one intent of a tick that counts, and the others: DAMP wins, then QUIT, then the first."""
    if not intents:
        return None, ()
    chosen = next((wanted for wanted in (Intent.DAMP, Intent.QUIT) if wanted in intents), intents[0])
    return chosen, tuple(dict.fromkeys(intent for intent in intents if intent is not chosen))


def granted_intent(intents: Sequence[Intent], refusals: Sequence[str]) -> Intent | None:
    """Return the intent that took effect in a tick, given those that came and its output's refusals; None if none did.

    Every intent but the chosen one is refused; one refusal more is that of the chosen one.
    """
    chosen, superseded = choose_intent(intents)
    return None if len(refusals) > len(superseded) else chosen


def transition(
    current: str,
    safety: SafetyStatus,
    intent: Intent | None,
    standby_finished: bool,
    available: Container[str],
    unready: str = "",
) -> Decision:
    """Return who is in control next.

    ================= ============================ ==============================
    intent            from                         to
    ================= ============================ ==============================
    DAMP              any                          `damping_controller`
    LOAD_A, LOAD_B    DAMPING                      `standby_controller_a`, `_b`
    START_LOCOMOTION  STANDBY and finished         `rl_policy_controller`
    START_REMOTE      STANDBY and finished         `remote_policy_controller`
    QUIT              ZERO_TORQUE, DAMPING         quit
    ================= ============================ ==============================

    Everything else is refused. Safety comes before intents: any status but OK moves STANDBY, LOCOMOTION and REMOTE to
    DAMPING and refuses every intent but DAMP and QUIT while it lasts. It never moves ZERO_TORQUE up, and nothing
    recovers by itself. Where there is no damping controller, ZERO_TORQUE stands in.

    Args:
        safety: all sources merged.
        standby_finished: the standby controller's command has arrived at its final pose and gains.
        available: names of the controllers that exist.
        unready: reason why the controller that is to move the robot cannot start yet; '' for none.
    """
    mode = MODES[current]
    if not safety.is_ok:
        return _unsafe(mode, current, safety, intent, available)
    if intent is None:
        return Decision()
    rule = RULES[intent]
    refusal = _refusal(intent, rule, mode, current, standby_finished, available)
    if not refusal and rule.standby_finished and unready:
        refusal = f"{intent.name} refused: {unready}"
    if refusal:
        return Decision(refusal=refusal)
    if rule.target is None:
        return Decision(quit=True, message=f"{intent.name} requested")
    if intent is Intent.DAMP:
        return _damp(current, f"{intent.name} requested", available)
    return Decision(rule.target, message=f"{intent.name} requested")


def granted(
    current: str, safety: SafetyStatus, standby_finished: bool, available: Container[str]
) -> tuple[Intent, ...]:
    """Return the intents that `transition` would not refuse; arguments as there."""
    asked = ((intent, transition(current, safety, intent, standby_finished, available)) for intent in RULES)
    return tuple(intent for intent, decision in asked if not decision.refusal)


def _unsafe(
    mode: Mode, current: str, safety: SafetyStatus, intent: Intent | None, available: Container[str]
) -> Decision:
    reason = describe_safety(safety)
    refusal = "" if intent is None or intent in _ALWAYS_HEARD else f"{intent.name} refused: {reason}"
    if intent is Intent.QUIT:
        refusal = _refusal(intent, RULES[intent], mode, current, False, available)
    if mode in MOVING:
        demoted = _damp(current, reason, available)
        return Decision(demoted.controller, message=demoted.message, refusal=refusal)
    if intent is Intent.DAMP:
        return _damp(current, f"{intent.name} requested", available)
    if intent is Intent.QUIT:
        return Decision(quit=True, message="QUIT requested", refusal=refusal)
    return Decision(refusal=refusal)


def _damp(current: str, reason: str, available: Container[str]) -> Decision:
    if DAMPING not in available:
        return Decision(ZERO_TORQUE, message=f"{reason}; {DAMPING} is not available")
    if current == DAMPING:
        return Decision()
    return Decision(DAMPING, message=reason)


def _refusal(
    intent: Intent,
    rule: Rule,
    mode: Mode,
    current: str,
    standby_finished: bool,
    available: Container[str],
) -> str:
    if mode not in rule.modes:
        return f"{intent.name} refused: requires {rule.requirement}, mode is {mode.name}"
    if rule.standby_finished and not standby_finished:
        return f"{intent.name} refused: requires {rule.requirement}, {current} has not finished"
    if rule.target is not None and intent is not Intent.DAMP and rule.target not in available:
        return f"{intent.name} refused: {rule.target} is not available"
    return ""
