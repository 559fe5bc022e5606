"""Stretches of a recording in which one controller moved the robot, sampled evenly: what data sets are made of."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.recording.reader import Recording

_DEFAULT_RATE = 50.0  # frames per second where no policy step says better; the control rate if that is lower


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """One stretch, F frames, evenly spaced."""

    mode: Mode
    fps: float
    ticks: list[TickRecord]
    """F ticks, one per frame, every joint of which was received."""
    motion_frame: list[int]
    """Frame of the reference motion that the policy was last shown, -1 for none; F of them."""

    def __len__(self) -> int:
        return len(self.ticks)


def read_episodes(recording: Recording, modes: frozenset[Mode], fps: float | None = None) -> Iterator[Episode]:
    """Yield the stretches in the given modes, in order. A missed deadline or a lost tick ends a stretch.

    In LOCOMOTION a stretch begins with its first policy step, so that at the policy's rate every frame is one. Without
    `fps` the rate is that of the policy's steps, or 50 Hz without them. Raises `InputError` if the control rate is not
    a multiple of `fps`, or a joint was never received.
    """
    period = recording.header.control_period
    stretch: list[TickRecord] = []
    for tick in recording.ticks():
        mode = tick.output.control_mode.mode
        if stretch and not _continues(stretch[-1], tick, period):
            yield from _sample(recording, stretch, fps)
            stretch = []
        if mode in modes and (stretch or mode is not Mode.LOCOMOTION or tick.output.policy_step is not None):
            stretch.append(tick)
    yield from _sample(recording, stretch, fps)


def _continues(before: TickRecord, tick: TickRecord, period: float) -> bool:
    is_late = abs(float(tick.input.state.time) - float(before.input.state.time) - period) > 0.5 * period
    is_same = tick.output.control_mode.mode is before.output.control_mode.mode
    return is_same and tick.index == before.index + 1 and not is_late


def _sample(recording: Recording, stretch: list[TickRecord], fps: float | None) -> Iterator[Episode]:
    """Yield the episode of a stretch, unless it is shorter than two frames."""
    control = 1.0 / recording.header.control_period
    steps = [tick.index for tick in stretch if tick.output.policy_step is not None]
    natural = control / (steps[1] - steps[0]) if len(steps) > 1 else min(_DEFAULT_RATE, control)
    rate = natural if fps is None else fps
    step = max(1, round(control / rate))
    if not math.isclose(control / rate, step, rel_tol=1e-6):
        possible = ", ".join(f"{control / k:g}" for k in range(1, 9) if math.isclose(control / k, round(control / k)))
        problem = f"its {control:g} ticks per second cannot be sampled {rate:g} times"
        raise InputError(f"{recording.path}: {problem}; --fps: {possible}")
    chosen = stretch[::step]
    if len(chosen) < 2:
        return
    for tick in chosen:
        silent = np.flatnonzero(~np.isfinite(tick.input.state.joint_position))
        if len(silent):
            joint, time = recording.header.joint_names[silent[0]], float(tick.input.state.time)
            raise InputError(f"{recording.path}: joint '{joint}' was not received until {time:g} s")
    shown, frames = -1, []
    for tick in stretch:
        shown = shown if tick.output.policy_step is None else tick.output.policy_step.frame
        frames.append(shown)
    yield Episode(stretch[0].output.control_mode.mode, rate, chosen, frames[::step])
