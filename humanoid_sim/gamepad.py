"""`python -m humanoid_sim.gamepad`: drives a running session with a gamepad."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import Intake, SessionError, monotonic_ns
from humanoid_sim.controllers.joy import JoyBindings, pressed_intents
from humanoid_sim.frontends.attach import attached, run_steps
from humanoid_sim.frontends.joy import policy_speeds, read_bindings, stick_velocity
from humanoid_sim.frontends.pads import Pad, Pads
from humanoid_sim.messages import Intent
from humanoid_sim.mit import FloatArray

_PERIOD = 0.01  # s between two polls
_REPEAT = 10  # polls after which DAMP is sent again
_ANSWER = 0.001  # s that an answer is waited for in a poll
_MOVED = 0.02  # m/s or rad/s by which a stick must move to claim the velocity


@dataclass(frozen=True)
class GamepadConfig:
    """Drive a running session with a gamepad.

    X damps, L1+A and L1+B load pose A and B, R1+A starts LOCOMOTION, R1+B REMOTE, BACK quits; the sticks command a
    velocity, of a policy that takes one. X damps on every gamepad that is plugged in; all else is the first one's.
    """

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    mapping: Path | None = None
    """Buttons (.yaml): joy: {damp_button: 2, load_combo_a: [4, 0], ...}, or a ROS 2 parameter file with joy.* of
    mode_manager."""


class Driver:
    """Requests of a session what gamepads show; `step` once a period."""

    def __init__(self, intake: Intake, joy: JoyBindings, *, speeds: FloatArray | None, is_hardware: bool) -> None:
        """Choose no gamepad yet; full sticks command `speeds`, shape (3, 2), None where no policy takes a velocity."""
        self._intake, self._joy, self._speeds, self._is_hardware = intake, joy, speeds, is_hardware
        self._pad: Pad | None = None
        self._velocity = np.zeros(3)
        self._polls, self._polled = 0, monotonic_ns()
        self._token, self._damped_at = "", 0
        """Token of the latest request, and the poll of its DAMP; empty and 0 once it is answered."""

    def step(self, pads: Sequence[Pad]) -> list[str]:
        """Act on one poll of the gamepads; lines for the operator. Raises `SessionError` if the session has ended."""
        seen, self._polled = self._polled, monotonic_ns()  # what this poll has found came after the one before
        self._polls += 1
        lines = self._answer()
        requested = [Intent.DAMP] if self._damped_at and self._polls - self._damped_at >= _REPEAT else []
        if self._pad not in pads:
            requested += self._choose(pads, lines)
        for pad in pads:
            for before, buttons in pad.changes:
                intents = pressed_intents(self._joy, buttons, before)
                requested += [intent for intent in intents if pad is self._pad or intent is Intent.DAMP]
        if Intent.DAMP in requested:
            requested, self._damped_at = [Intent.DAMP], self._polls
        for intent in requested:
            self._token = self._intake.post(intent.value, seen=seen)
        if self._pad is not None:
            self._intake.heartbeat()
            self._steer(self._pad)
        return lines

    def _choose(self, pads: Sequence[Pad], lines: list[str]) -> list[Intent]:
        """Choose another gamepad; returns DAMP if the one before was lost on hardware."""
        lost = self._pad is not None
        if self._pad is not None:
            lines.append(f"{self._pad.name} is gone")
        self._pad, self._velocity = next((pad for pad in pads if pad.is_known), None), np.zeros(3)
        if self._pad is not None:
            lines.append(f"{self._pad.name} drives")
        return [Intent.DAMP] if lost and self._is_hardware else []

    def _answer(self) -> list[str]:
        """Return the session's answer to the latest request, if it has come."""
        if not self._token:
            return []
        try:
            text = self._intake.answer(self._token, _ANSWER).text
        except SessionError:
            return []
        self._token, self._damped_at = "", 0
        return [text]

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
    joy = JoyBindings() if config.mapping is None else read_bindings(config.mapping)
    with closing(Pads()) as pads, attached(config.session, "gamepad") as attachment:
        speeds, hardware = policy_speeds(attachment.header), attachment.is_hardware
        driver = Driver(attachment.intake, joy, speeds=speeds, is_hardware=hardware)
        print(f"{len(pads.poll())} gamepads are plugged in", flush=True)
        run_steps(attachment, lambda: driver.step(pads.poll()), _PERIOD)
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
