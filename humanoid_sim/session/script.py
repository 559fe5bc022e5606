"""Intents from a script: `damp; load_b; wait; start_remote; hold 5; damp`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import NamedTuple

from humanoid_sim.errors import InputError, meant, number_in
from humanoid_sim.messages import Intent, Mode, SafetyStatus, TickOutput
from humanoid_sim.session.requests import Requests
from humanoid_sim.session.sources import IntentSource

_INTENTS = {intent.value: intent for intent in Intent}
_GRAMMAR = f"{', '.join(_INTENTS)}, wait, motion, hold SECONDS, policy NAME"


class ScriptStep(NamedTuple):
    """One step: send an intent, select a policy, or let time pass."""

    kind: str  # `intent`, `wait`, `motion`, `hold` or `policy`
    intent: Intent | None = None
    seconds: float = 0.0
    policy: str = ""


def parse_script(text: str) -> tuple[ScriptStep, ...]:
    """Parse steps separated by semicolons.

    An intent's name sends it; `wait` lasts until the standby pose is reached; `motion` until the policy's motion has
    ended; `hold 5` for 5 s on the robot's clock; `policy dance` selects one of several.
    """
    steps = []
    for number, part in enumerate(text.split(";"), start=1):
        match part.split():
            case []:
                continue
            case [word] if word.lower() in _INTENTS:
                steps.append(ScriptStep("intent", _INTENTS[word.lower()]))
            case [word] if word.lower() in ("wait", "motion"):
                steps.append(ScriptStep(word.lower()))
            case [word, seconds] if word.lower() == "hold" and number_in(seconds) >= 0.0:
                steps.append(ScriptStep("hold", seconds=number_in(seconds)))
            case [word, name] if word.lower() == "policy":
                steps.append(ScriptStep("policy", policy=name))
            case [word, *_]:
                near = meant(word, _INTENTS)
                raise InputError(f"--script: step {number} is '{part.strip()}'{near}, expected one of {_GRAMMAR}")
    if not steps:
        raise InputError(f"--script: is empty, expected steps separated by ';', each one of {_GRAMMAR}")
    return tuple(steps)


@dataclass(eq=False)
class Script(IntentSource):
    """Plays steps and finishes after the last one.

    Whatever goes wrong (a controller that fails, a safety status that is not OK, a fall to DAMPING or ZERO_TORQUE that
    the script did not request) drops the rest of it: nothing that was planned before a fault may move the robot after
    it. So do operators' intents, and a fresh start.
    """

    steps: Sequence[ScriptStep]
    _: KW_ONLY
    requests: Requests = field(default_factory=Requests)
    operators: Sequence[IntentSource] = ()  # take over with their first intent; polled in every tick

    def __post_init__(self) -> None:
        self._steps = list(self.steps)
        self._hold_until: float | None = None
        self._frame: int | None = None  # that the policy was shown last
        self._is_motion_over = self._was_moving = self._requested_damp = False
        self._is_taken_over = self._has_begun = False

    @property
    def finished(self) -> bool:
        return not self._steps and not self._is_taken_over

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        intents = [intent for source in self.operators for intent in source.poll(time, output)]
        if intents or (self._has_begun and output is None):
            self._is_taken_over = True
            self._steps.clear()
        if output is not None:
            self._has_begun = True
            self._follow(output)
        if not self._steps or not self._is_due(self._steps[0], time, output):
            return intents
        step = self._steps.pop(0)
        self._hold_until = None
        if step.kind == "policy":
            self.requests.policy = step.policy
        if step.intent is None:
            return intents
        self._frame, self._is_motion_over, self._requested_damp = None, False, step.intent is Intent.DAMP
        return [step.intent]

    def note_safety(self, statuses: Sequence[SafetyStatus]) -> None:
        """Drop the rest if a status is not OK; the FSM itself refuses intents while it lasts."""
        if not all(status.is_ok for status in statuses):
            self._steps.clear()

    def _follow(self, output: TickOutput) -> None:
        if output.policy_step is not None:  # the last frame of a motion is held
            self._is_motion_over = output.policy_step.frame == self._frame
            self._frame = output.policy_step.frame
        is_moving = output.control_mode.mode not in (Mode.ZERO_TORQUE, Mode.DAMPING)
        fell = self._was_moving and not is_moving and not self._requested_damp
        self._was_moving = is_moving
        if output.faults or fell:
            self._steps.clear()

    def _is_due(self, step: ScriptStep, time: float, output: TickOutput | None) -> bool:
        if step.kind in ("intent", "policy"):
            return True
        if output is None:
            return False
        if step.kind == "wait":  # out of STANDBY, by a fault or a refusal, there is nothing to wait for
            return output.standby is None or output.standby.is_finished
        if step.kind == "motion":
            return self._is_motion_over or output.control_mode.controller_name != "rl_policy_controller"
        if self._hold_until is None:
            self._hold_until = time + step.seconds
        return time >= self._hold_until
