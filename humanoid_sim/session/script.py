"""Intents from a script: `damp; load_b; wait; start_remote; hold 5; damp`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from humanoid_sim.errors import InputError, meant, number_in
from humanoid_sim.messages import Intent, Mode, SafetyStatus, TickOutput
from humanoid_sim.session.sources import IntentSource, PolicySelection

_INTENTS = {intent.value: intent for intent in Intent}
_GRAMMAR = f"{', '.join(_INTENTS)}, wait, motion, hold SECONDS, policy NAME"


@dataclass(frozen=True, slots=True)
class ScriptStep:
    """One step: send an intent, select a policy, or let time pass."""

    kind: Literal["intent", "wait", "motion", "hold", "policy"]
    intent: Intent | None = None
    seconds: float = 0.0
    policy: str = ""


def parse_script(text: str) -> tuple[ScriptStep, ...]:
    """Parse steps separated by semicolons.

    An intent's name sends it; `wait` lasts until the standby pose is reached; `motion` until the policy's motion has
    ended; `hold 5` for 5 s on the robot's clock; `policy dance` selects one of several. Raises `InputError` naming the
    step and what is accepted.
    """
    steps = []
    for number, part in enumerate((part.strip() for part in text.split(";")), start=1):
        if not part:
            continue
        word, *arguments = part.split()
        word = word.lower()
        if word in _INTENTS and not arguments:
            steps.append(ScriptStep("intent", _INTENTS[word]))
        elif word in ("wait", "motion") and not arguments:
            steps.append(ScriptStep("wait" if word == "wait" else "motion"))
        elif word == "hold" and len(arguments) == 1:
            seconds = number_in(arguments[0])
            if not seconds >= 0.0:
                raise InputError(f"--script: step {number} is '{part}', expected hold with a number of seconds >= 0")
            steps.append(ScriptStep("hold", seconds=seconds))
        elif word == "policy" and len(arguments) == 1:
            steps.append(ScriptStep("policy", policy=arguments[0]))
        else:
            words = (*_INTENTS, "wait", "motion", "hold", "policy")
            near = "" if word in words else meant(word, words)
            raise InputError(f"--script: step {number} is '{part}'{near}, expected one of {_GRAMMAR}")
    if not steps:
        raise InputError(f"--script: is empty, expected steps separated by ';', each one of {_GRAMMAR}")
    return tuple(steps)


class Script:
    """Plays steps as an `IntentSource` and finishes after the last one.

    Whatever goes wrong (a controller that fails, a safety status that is not OK, in whatever mode, a fall to DAMPING or
    ZERO_TORQUE that the script did not ask for) drops the rest of it: nothing that was planned before a fault may move
    the robot after it.
    """

    def __init__(
        self,
        steps: Sequence[ScriptStep],
        motion_frames: int = 0,
        *,
        selection: PolicySelection | None = None,
        frames: Mapping[str, int] | None = None,
    ) -> None:
        """Begin with the first step.

        Args:
            motion_frames: length of the motion of the policy that is selected at the start, in policy steps.
            selection: takes requests for another policy.
            frames: likewise of each policy, by name, where there are several.
        """
        self._steps = list(steps)
        self.motion_frames = motion_frames
        self._selection, self._frames = selection or PolicySelection(), frames or {}
        self._hold_until: float | None = None
        self._motion_over = False
        self._was_moving = False
        self._asked_to_damp = False
        self._has_asked = False
        self.refusals: list[str] = []
        """Refusals of its own intents."""

    @property
    def finished(self) -> bool:
        """All steps are done."""
        return not self._steps

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Get the intent that is due, if any: one per tick, so that each is decided on the result of the one before."""
        if output is not None and output.policy_step is not None:
            self._motion_over = output.policy_step.frame >= self.motion_frames - 1
        if output is not None and (output.faults or self._fell(output.control_mode.mode)):
            self.cancel()
        if output is not None and self._has_asked:
            self.refusals += output.refusals
        self._has_asked = False
        if not self._steps:
            return ()
        step = self._steps[0]
        if step.kind == "policy":
            self._steps.pop(0)
            self._has_asked = True
            self._selection.request(step.policy)
            self.motion_frames = self._frames.get(step.policy, self.motion_frames)
            return ()
        if step.intent is not None:
            self._steps.pop(0)
            self._has_asked = True
            self._motion_over = False
            self._asked_to_damp = step.intent is Intent.DAMP
            return (step.intent,)
        if self._is_over(step, time, output):
            self._steps.pop(0)
            self._hold_until = None
        return ()

    def cancel(self) -> None:
        """Drop the steps that are left."""
        self._steps.clear()

    def note_safety(self, statuses: Sequence[SafetyStatus]) -> None:
        """Take the tick's safety statuses into account; the FSM itself refuses intents while they last."""
        if not all(status.is_ok for status in statuses):
            self.cancel()

    def _fell(self, mode: Mode) -> bool:
        moving = mode not in (Mode.ZERO_TORQUE, Mode.DAMPING)
        fell = self._was_moving and not moving and not self._asked_to_damp
        self._was_moving = moving
        return fell

    def _is_over(self, step: ScriptStep, time: float, output: TickOutput | None) -> bool:
        if output is None:
            return False
        if step.kind == "wait":
            # Fallen out of STANDBY (a fault, a refusal): waiting on would be waiting for ever.
            return output.standby is None or output.standby.is_finished
        if step.kind == "motion":
            return self._motion_over or output.control_mode.controller_name != "rl_policy_controller"
        if self._hold_until is None:
            self._hold_until = time + step.seconds
        return time >= self._hold_until


class OverriddenScript:
    """A script, and operators whose first intent ends the script.

    So does a fresh start, for which an operator asked: it is seen by the outputs of ticks beginning again.
    """

    def __init__(self, script: Script, operators: Sequence[IntentSource]) -> None:
        """Play the script until an operator acts, each of whom is asked every tick."""
        self._script = script
        self._operators = tuple(operators)
        self._taken_over = False
        self._has_begun = False

    @property
    def finished(self) -> bool:
        """The script is done, and no operator has taken over."""
        return self._script.finished and not self._taken_over

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return the operators' intents, else the script's."""
        intents = [intent for source in self._operators for intent in source.poll(time, output)]
        starts_afresh = self._has_begun and output is None
        self._has_begun = self._has_begun or output is not None
        if (intents or starts_afresh) and not self._taken_over:
            self._taken_over = True
            self._script.cancel()
        return intents if self._taken_over else self._script.poll(time, output)
