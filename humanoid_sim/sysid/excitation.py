"""A motion that excites every joint, slow to fast, within its limits, and what a fit can be expected to find with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.guards import guards_of
from humanoid_sim.simulation.check_poses import Touching
from humanoid_sim.sysid.data import Run, Window, windows
from humanoid_sim.sysid.fit import FreeParameter, expected_half_widths
from humanoid_sim.sysid.model import FitModel

_LOWEST, _HIGHEST, _TONES = 0.1, 2.5, 7
"""Hz; sines of each joint."""
_SPREAD = 0.35
"""Share of its range that a joint moves to each side, at most."""
_LARGEST = 0.7
"""rad, likewise."""
_SPEED, _EFFORT = 0.4, 0.6
"""Share of the guards' speed, and of the effort limit, that may be used."""
_WALK = 3.0
"""s in which the motion swells, and dies down at its end."""
_TRIES = 12
_SHRINK = 0.8
_MARGIN = 0.05
"""rad that stay free at both limits of a joint."""


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """A motion of all joints, and what is expected of it."""

    target: FloatArray
    """Shape (frames, n), rad: where each joint is told to be."""
    period: float
    """s between two frames."""
    expected: tuple[tuple[FreeParameter, float], ...]
    """Parameters with the half-widths that a fit will have, as far as a simulation tells."""
    effort_share: float
    """Greatest share of an effort limit that the simulation needed."""
    amplitude: FloatArray
    """Shape (n,), rad, greatest distance from the middle of each joint's motion."""

    @property
    def duration(self) -> float:
        """Seconds."""
        return len(self.target) * self.period


def excite(description: RobotDescription, duration: float, period: float, seed: int = 0) -> Excitation:
    """Make the motion: a sum of sines per joint, from and to the pose of STANDBY.

    Where parts of the robot would touch, or a joint would need too much torque or speed, the amplitudes shrink.

    Raises:
        InputError: it is too short, a joint has no limits or no K_p, or no amplitude is small enough.
    """
    if not 10.0 <= duration <= 600.0:
        raise InputError(f"--duration: is {duration:g}, expected 10 to 600 s")
    for joint in description.joints:
        if not (np.isfinite(joint.lower) and np.isfinite(joint.upper) and joint.stiffness > 0.0):
            raise InputError(f"{description.name}: joint '{joint.name}' needs limits and a stiffness for an excitation")
    start = np.array(description.standby_controller_a.pose_segments[-1])
    lower, upper = description.lower + _MARGIN, description.upper - _MARGIN
    reach = np.minimum(_SPREAD * (upper - lower), _LARGEST)
    middle = np.clip(start, lower + reach, upper - reach)
    time = period * np.arange(round(duration / period))
    swell = np.clip(np.minimum(time, time[-1] - time) / _WALK, 0.0, 1.0)
    swell = swell * swell * (3.0 - 2.0 * swell)
    waves, guards = _waves(len(start), time, np.random.default_rng(seed)), guards_of(description)
    speed = np.full(len(start), 5.0) if guards is None else np.minimum(guards.speed_limit, 10.0)
    share = np.minimum(
        1.0, _SPEED * speed / np.maximum(reach * np.abs(np.gradient(waves, period, axis=0)).max(0), 1e-9)
    )
    touching = Touching(description)
    for _ in range(_TRIES):
        target = np.clip(start + swell[:, None] * (middle - start + reach * share * waves), lower, upper)
        run = _simulated(description, target, period)
        load = np.abs(run.effort) / description.effort_limit
        heavy = load.max(axis=0) > _EFFORT
        touched = next((True for pose in run.position[::3] if touching(pose) - touching(start)), False)
        if not heavy.any() and not touched:
            expected = expected_half_widths(description, windows(run))
            return Excitation(target, period, expected, float(load.max()), np.abs(target - middle).max(axis=0))
        share = share * np.where(heavy | touched, _SHRINK, 1.0)
    raise InputError(
        f"{description.name}: no excitation was found in which nothing touches and no joint works too hard"
    )


def _waves(count: int, time: FloatArray, random: np.random.Generator) -> FloatArray:
    """Shape (frames, n), within ±1: each joint has tones of its own, the fast ones later and smaller."""
    tones = np.geomspace(_LOWEST, _HIGHEST, _TONES)
    waves = np.zeros((len(time), count))
    for joint in range(count):
        own = tones * random.uniform(0.85, 1.15, _TONES)
        phase = random.uniform(0.0, 2.0 * np.pi, _TONES)
        for i, (frequency, turn) in enumerate(zip(own, phase, strict=True)):
            begins = 0.3 * i / _TONES * time[-1]
            fade = np.clip((time - begins) / 2.0, 0.0, 1.0)
            waves[:, joint] += fade * (frequency / _LOWEST) ** -0.45 * np.sin(2.0 * np.pi * frequency * time + turn)
    return waves / np.abs(waves).max(axis=0)


def _simulated(description: RobotDescription, target: FloatArray, period: float) -> Run:
    """Return what a robot like its model would report of the motion."""
    frames, n = target.shape
    zeros = np.zeros((frames, n))
    gains = [np.broadcast_to(gain, (frames, n)) for gain in (description.stiffness, description.damping)]
    run = Run(
        "expected",
        period * np.arange(frames),
        np.broadcast_to(target[:1], target.shape),
        zeros,
        zeros,
        zeros,
        np.stack([target, zeros, zeros, *gains], axis=1),
        np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
    )
    model = FitModel(description, range(n))
    nominal = model.nominal()
    found = model.rollout([model.with_parameters(nominal)], [nominal], Window(run, 0, frames))[0]
    return Run(run.source, run.time, found.position, found.velocity, found.effort, zeros, run.command, run.quaternion)
