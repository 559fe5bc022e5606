"""Stretches of a recording in which one controller moved the robot, sampled evenly: what data sets are made of."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.reader import Recording

_DEFAULT_RATE = 50.0
"""Frames per second where no policy step says better; the control rate if that is lower."""


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """One stretch, F frames, evenly spaced."""

    mode: Mode
    fps: float
    start: float
    """s, robot's clock, of the first frame."""
    joint_position: FloatArray
    """Shape (F, n), rad, measured."""
    joint_velocity: FloatArray
    """Shape (F, n), rad/s, measured."""
    joint_effort: FloatArray
    """Shape (F, n), N·m, measured."""
    imu: FloatArray
    """Shape (F, 10): quaternion w x y z, angular velocity (rad/s) and linear acceleration (m/s²), body frame."""
    command_position: FloatArray
    """Shape (F, n), rad, as commanded in the same tick."""
    motion_frame: tuple[int, ...]
    """Frame of the reference motion that the policy was last shown, -1 for none; F of them."""

    def __len__(self) -> int:
        return len(self.joint_position)


def read_episodes(recording: Recording, modes: frozenset[Mode], fps: float | None = None) -> Iterator[Episode]:
    """Return the stretches in the given modes, in order. A missed deadline or a lost tick ends a stretch.

    In LOCOMOTION a stretch begins with its first policy step, so that at the policy's rate every frame is one. Without
    `fps` the rate is that of the policy's steps, or 50 Hz without them. Raises `InputError` if the control rate is not
    a multiple of `fps`, or a joint was never heard.
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
    if stretch:
        yield from _sample(recording, stretch, fps)


def _continues(before: TickRecord, tick: TickRecord, period: float) -> bool:
    late = abs(float(tick.input.state.time) - float(before.input.state.time) - period) > 0.5 * period
    return (
        tick.output.control_mode.mode is before.output.control_mode.mode and tick.index == before.index + 1 and not late
    )


def _sample(recording: Recording, stretch: list[TickRecord], fps: float | None) -> Iterator[Episode]:
    header = recording.header
    rate = _rate(stretch, header.control_period) if fps is None else fps
    ticks = 1.0 / (rate * header.control_period)
    step = max(1, round(ticks))
    if abs(ticks - step) > 1e-6 * step:
        control = 1.0 / header.control_period
        possible = ", ".join(f"{control / k:g}" for k in range(1, 9) if math.isclose(control / k, round(control / k)))
        raise InputError(
            f"{recording.path}: its {control:g} ticks per second cannot be sampled {rate:g} times; --fps: {possible}"
        )
    chosen = stretch[::step]
    if len(chosen) < 2:
        return
    states = [tick.input.state for tick in chosen]
    position = np.stack([state.joint_position for state in states])
    silent = np.argwhere(~np.isfinite(position))
    if len(silent):
        frame, joint = (int(i) for i in silent[0])
        raise InputError(
            f"{recording.path}: joint '{header.joint_names[joint]}' was not heard until {float(states[frame].time):g} s"
        )
    yield Episode(
        mode=stretch[0].output.control_mode.mode,
        fps=rate,
        start=float(states[0].time),
        joint_position=position,
        joint_velocity=np.stack([state.joint_velocity for state in states]),
        joint_effort=np.stack([state.joint_effort for state in states]),
        imu=np.stack(
            [
                np.concatenate([state.imu_quaternion, state.imu_angular_velocity, state.imu_linear_acceleration])
                for state in states
            ]
        ),
        command_position=np.stack([tick.output.command.position for tick in chosen]),
        motion_frame=_motion_frames(stretch)[::step],
    )


def _rate(stretch: list[TickRecord], period: float) -> float:
    """Policy steps per second; where there are none, the default."""
    steps = [tick.index for tick in stretch if tick.output.policy_step is not None]
    if len(steps) > 1:
        return 1.0 / (period * (steps[1] - steps[0]))
    return min(_DEFAULT_RATE, 1.0 / period)


def _motion_frames(stretch: list[TickRecord]) -> tuple[int, ...]:
    frames, last = [], -1
    for tick in stretch:
        if tick.output.policy_step is not None:
            last = tick.output.policy_step.frame
        frames.append(last)
    return tuple(frames)
