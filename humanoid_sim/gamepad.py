"""`python -m humanoid_sim.gamepad`: drives a running session with a gamepad."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import sleep

import numpy as np

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import Intake, Looks, SessionError
from humanoid_sim.controllers.joy import JoyBindings, pressed_intents
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends import require_packages
from humanoid_sim.frontends.attach import attached, ready, steps
from humanoid_sim.frontends.gamepad.device import Pad, Pads, missing_reason
from humanoid_sim.frontends.gamepad.layout import PadLayout, SpeedRange, Sticks, chosen_layout, policy_speeds
from humanoid_sim.messages import Intent

_PERIOD = 0.01
"""s between two looks at the buttons."""
_HEARTBEAT_EVERY = 2
"""Looks."""
_ANSWER_WITHIN = 0.05
"""s for which an answer of the session is waited for; on a session's own machine it comes within a tick."""
_UNKNOWN = "its buttons have their driver's numbers: see them with gamepad --list, bind them by --joy.*"
_MOVED = 0.02
"""m/s or rad/s by which a stick must move to say that somebody moved it."""


@dataclass(frozen=True)
class GamepadConfig:
    """Drive a running session with a gamepad.

    X damps, L1+A and L1+B load pose A and B, R1+A starts LOCOMOTION, R1+B REMOTE, BACK quits; the sticks command a
    velocity, of a policy that takes one. X damps on every gamepad that is plugged in; all else is the chosen one's.
    """

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    device: str = ""
    """Part of the gamepad's name. Default: the first one that is plugged in."""
    list: bool = False
    """Show the gamepads that are plugged in, with the buttons that are down, and end; 1 if there is none."""
    mapping: Path | None = None
    """Layout (.yaml): joy: with the names below, and sticks:, or a ROS 2 parameter file with joy.* of mode_manager."""
    raw: bool = False
    """Number buttons and axes as the driver does, not in the order of an Xbox pad."""
    joy: JoyBindings = field(default_factory=JoyBindings)
    sticks: Sticks = field(default_factory=Sticks)


class Driver:
    """From what the gamepads show to what a session is asked for; `step` once a period."""

    def __init__(self, intake: Intake, config: GamepadConfig, *, speeds: SpeedRange | None, is_hardware: bool) -> None:
        """Prepare.

        Args:
            speeds: shape (3, 2), what full sticks command; None: the policy takes no velocity.
            is_hardware: the loss of the gamepad damps.
        """
        self._intake, self._config, self.speeds, self._is_hardware = intake, config, speeds, is_hardware
        self._pad: Pad | None = None
        self._before: dict[int, tuple[bool, ...]] = {}
        self._velocity = np.zeros(3)
        self._looks, self._clock = 0, Looks()

    def step(self, pads: Sequence[Pad]) -> list[str]:
        """Act on one look at the gamepads; lines for the operator. Raises `SessionError` if the session has ended."""
        self._clock.look()
        lines = self._choose(pads)
        asked = []
        for pad in pads:
            before = self._before.get(pad.identity, ())
            intents = pressed_intents(self._config.joy, pad.buttons, before)
            is_chosen = self._pad is not None and pad.identity == self._pad.identity
            asked += [intent for intent in intents if is_chosen or intent is Intent.DAMP]
        self._before = {pad.identity: pad.buttons for pad in pads}
        if Intent.DAMP in asked:
            asked = [Intent.DAMP]
        lines += [self._ask(intent) for intent in asked]
        if self._pad is not None:
            if self._looks % _HEARTBEAT_EVERY == 0:
                self._intake.heartbeat()
            self._steer(self._pad)
        self._looks += 1
        return lines

    def _choose(self, pads: Sequence[Pad]) -> list[str]:
        """Take the chosen gamepad as it is now, or another one where it is gone."""
        before = self._pad
        fitting = [pad for pad in pads if self._config.device.lower() in pad.name.lower()]
        self._pad = next((pad for pad in fitting if before is not None and pad.identity == before.identity), None)
        if self._pad is not None:
            return []
        lines = []
        if before is not None:
            lines.append(f"{before.name} is gone")
            self._velocity = np.zeros(3)
            if self._is_hardware:
                lines.append(self._ask(Intent.DAMP))
        for pad in fitting:
            problem = _problem(pad, self._config.joy)
            if problem:
                lines.append(f"{pad} is not used: {problem}" if pad.identity not in self._before else "")
                continue
            self._pad = pad
            lines.append(f"{pad} drives")
            if not pad.is_known:
                lines.append(_UNKNOWN)
            break
        return [line for line in lines if line]

    def _ask(self, intent: Intent) -> str:
        token = self._intake.post(intent.name.lower(), seen=self._clock.stamp)
        try:
            return self._intake.answer(token, _ANSWER_WITHIN).text
        except SessionError:
            return f"{intent.name} requested"

    def _steer(self, pad: Pad) -> None:
        if self.speeds is None:
            return
        velocity = self._config.sticks.velocity(pad.axes, self.speeds)
        moved = bool(np.abs(velocity - self._velocity).max() > _MOVED)
        if moved:
            self._velocity = velocity
        self._intake.velocity(*velocity.tolist(), deliberate=moved and bool(velocity.any()))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(GamepadConfig, "gamepad", arguments)
    require_packages("gamepad")
    layout = chosen_layout(config.mapping, PadLayout(config.joy, config.sticks), "--mapping")
    config = replace(config, joy=layout.joy, sticks=layout.sticks)
    pads = Pads(raw=config.raw)
    try:
        if config.list:
            return _list(pads, config.joy)
        return _drive(pads, config)
    finally:
        pads.close()


def _list(pads: Pads, joy: JoyBindings) -> int:
    """Print each gamepad, with what an operator should know before it drives; 1 if none can be used."""
    found = pads.look()
    problems = [_problem(pad, joy) for pad in found]
    for pad, problem in zip(found, problems, strict=True):
        down = [str(index) for index, is_down in enumerate(pad.buttons) if is_down]
        note = f"; cannot be used: {problem}" if problem else "" if pad.is_known else f"; {_UNKNOWN}"
        print(f"{pad}; down: {', '.join(down) or 'none'}{note}")
    if not found:
        print(missing_reason())
    return 0 if "" in problems else 1


def _problem(pad: Pad, joy: JoyBindings) -> str:
    """Return why a gamepad cannot be used with these bindings; empty if it can."""
    try:
        joy.check(len(pad.buttons))
    except FieldError as error:
        return str(error)
    return ""


def _drive(pads: Pads, config: GamepadConfig) -> int:
    with attached(config.session, "gamepad") as attachment:
        is_hardware = bool(attachment.session.hardware)
        driver = Driver(
            attachment.intake, config, speeds=policy_speeds(attachment.walking_contract), is_hardware=is_hardware
        )
        found = pads.look()
        ready(f"{found[0] if found else 'waits for a gamepad to be plugged in'}")
        for _ in steps(attachment, lambda: driver.step(pads.look())):
            sleep(_PERIOD)
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
