"""Stretches of a recording in which one controller moved the robot, sampled evenly: what data sets are made of."""

from __future__ import annotations

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


def read_episodes(recording: Recording, modes: frozenset[Mode], fps: float | None = None) -> Iterator[Episode]:
    """Yield the stretches in the given modes of at least two frames, in order.

    A missed deadline, a lost tick or a joint that was never received ends a stretch. In LOCOMOTION it begins with a
    policy step, so that at the policy's rate every frame is one. Without `fps` the rate is that of the policy's steps,
    or 50 Hz without them. Raises `InputError` if the control rate is not a multiple of `fps`.
    """
    period = recording.header.control_period
    stretch: list[TickRecord] = []
    for tick in recording.ticks():
        if stretch and not _continues(stretch[-1], tick, period):
            yield from _sample(recording, stretch, fps)
            stretch = []
        mode = tick.output.control_mode.mode
        is_begun = stretch or mode is not Mode.LOCOMOTION or tick.output.policy_step is not None
        if mode in modes and is_begun and np.isfinite(tick.input.state.joint_position).all():
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
    rate = control / (steps[1] - steps[0]) if len(steps) > 1 else min(_DEFAULT_RATE, control)
    rate = fps or rate
    step = max(1, round(control / rate))
    if abs(control / rate - step) > 1e-6:
        raise InputError(f"{recording.path}: --fps: is {rate:g}, expected a divisor of its {control:g} ticks a second")
    if len(stretch) > step:
        yield Episode(stretch[0].output.control_mode.mode, rate, stretch[::step])
