"""`python -m humanoid_sim.gamepad`: drives a running session with a gamepad."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import sleep

import numpy as np

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import Intake, SessionError, monotonic_ns
from humanoid_sim.controllers.joy import JoyBindings, pressed_intents
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.attach import attached, ready, steps
from humanoid_sim.frontends.gamepad.device import Pad, Pads
from humanoid_sim.frontends.gamepad.layout import PadLayout, chosen_layout, policy_speeds, stick_velocity
from humanoid_sim.messages import Intent
from humanoid_sim.mit import FloatArray

_PERIOD = 0.01  # s between two polls
_HEARTBEAT_EVERY = 2  # polls
_ANSWER, _REPEAT = 0.001, 0.1  # s that an answer is waited for in a poll, and after which DAMP is sent again
_MOVED = 0.02  # m/s or rad/s by which a stick must move to claim the velocity


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
    """Show the gamepads that are plugged in, and end; 1 if none can be used."""
    mapping: Path | None = None
    """Buttons (.yaml): joy: with the names below, or a ROS 2 parameter file with joy.* of mode_manager."""
    joy: JoyBindings = field(default_factory=JoyBindings)


class Driver:
    """From what the gamepads show to what is requested of a session; `step` once a period."""

    def __init__(self, intake: Intake, config: GamepadConfig, *, speeds: FloatArray | None, is_hardware: bool) -> None:
        """Choose no gamepad yet.

        Args:
            speeds: shape (3, 2), what full sticks command; None: the policy takes no velocity.
            is_hardware: the loss of the gamepad damps.
        """
        self._intake, self._config, self._speeds, self._is_hardware = intake, config, speeds, is_hardware
        self._pad: Pad | None = None
        self._refused: set[Pad] = set()
        self._velocity = np.zeros(3)
        self._polls, self._polled, self._now = 0, 0, monotonic_ns()
        self._waiting: tuple[str, Intent, int] | None = None
        """Token of the latest request, and when it was posted, ns; None once it is answered."""

    def step(self, pads: Sequence[Pad]) -> list[str]:
        """Act on one poll of the gamepads; lines for the operator. Raises `SessionError` if the session has ended."""
        self._polled, self._now = self._now, monotonic_ns()  # what this poll has found came after the one before
        lines = [*self._answer(), *self._choose(pads)]
        requested: list[Intent] = []
        for pad in pads:
            for before, buttons in pad.changes:
                intents = pressed_intents(self._config.joy, buttons, before)
                requested += [intent for intent in intents if pad is self._pad or intent is Intent.DAMP]
        if Intent.DAMP in requested or self._is_damp_lost():
            requested = [Intent.DAMP]
        for intent in requested:
            self._ask(intent)
        if self._pad is not None:
            if self._polls % _HEARTBEAT_EVERY == 0:
                self._intake.heartbeat()
            self._steer(self._pad)
        self._polls += 1
        return lines

    def _choose(self, pads: Sequence[Pad]) -> list[str]:
        """Choose another gamepad where the chosen one is gone."""
        if self._pad in pads:
            return []
        lines = []
        if self._pad is not None:
            lines.append(f"{self._pad} is gone")
            self._pad, self._velocity = None, np.zeros(3)
            if self._is_hardware:
                self._ask(Intent.DAMP)
        for pad in pads:
            problem = _problem(pad, self._config.joy)
            if self._config.device.lower() not in pad.name.lower() or pad in self._refused:
                continue
            if problem:
                self._refused.add(pad)
                lines.append(f"{pad.name} is not used: {problem}")
                continue
            self._pad = pad
            lines.append(f"{pad} drives")
            break
        return lines

    def _ask(self, intent: Intent) -> None:
        self._waiting = self._intake.post(intent.name.lower(), seen=self._polled), intent, monotonic_ns()

    def _answer(self) -> list[str]:
        """Return the session's answer to the intent before, if it has come."""
        if self._waiting is None:
            return []
        try:
            text = self._intake.answer(self._waiting[0], _ANSWER).text
        except SessionError:
            return []
        self._waiting = None
        return [text]

    def _is_damp_lost(self) -> bool:
        """Return whether DAMP is to be sent again: the session has not answered."""
        if self._waiting is None or self._waiting[1] is not Intent.DAMP:
            return False
        return 1e-9 * (monotonic_ns() - self._waiting[2]) > _REPEAT

    def _steer(self, pad: Pad) -> None:
        if self._speeds is None:
            return
        velocity = stick_velocity(pad.axes, self._speeds)
        moved = bool(np.abs(velocity - self._velocity).max() > _MOVED)
        if moved:
            self._velocity = velocity
        self._intake.velocity(*velocity.tolist(), deliberate=moved and bool(velocity.any()))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(GamepadConfig, "gamepad", arguments)
    config = replace(config, joy=chosen_layout(config.mapping, PadLayout(config.joy), "--mapping").joy)
    pads = Pads()
    try:
        if config.list:
            return _list(pads, config.joy)
        with attached(config.session, "gamepad") as attachment:
            speeds = policy_speeds(attachment.walking_contract)
            driver = Driver(attachment.intake, config, speeds=speeds, is_hardware=attachment.is_hardware)
            found = pads.poll()
            ready(f"{found[0] if found else 'waits for a gamepad to be plugged in'}")
            for _ in steps(attachment, lambda: driver.step(pads.poll())):
                sleep(_PERIOD)
        return 0
    finally:
        pads.close()


def _list(pads: Pads, joy: JoyBindings) -> int:
    """Print each gamepad, and why it cannot be used; 1 if none can."""
    found = {pad: _problem(pad, joy) for pad in pads.poll()}
    for pad, problem in found.items():
        print(f"{pad.name}{problem and f' cannot be used: {problem}'}")
    if not found:
        print(pads.missing_reason())
    return 0 if "" in found.values() else 1


def _problem(pad: Pad, joy: JoyBindings) -> str:
    """Return why a gamepad cannot be used with these bindings; empty if it can."""
    if not pad.is_known:
        return "its layout is not known; many have a switch for Xbox pads (XInput)"
    try:
        joy.check(len(pad.buttons))
    except FieldError as error:
        return str(error)
    return ""


if __name__ == "__main__":
    sys.exit(run_program(main))
