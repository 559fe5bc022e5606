"""Are a motion's joint velocities the derivatives of its joint positions, joint by joint? If not, what are they?

The derivative of sampled positions depends on how it is taken: forward, backward and central differences of a fast
joint differ by a tenth and more, and the true derivative from all three. So velocities are compared with each of these
and judged by the one that they resemble most.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray

_LEAST_FRAMES = 12
"""Fewer say nothing."""
_EDGE = 3
"""Frames at both ends that the widest difference does not reach."""
_CALM = 0.2
"""s, over which the mean is taken before velocities are called unlike: that takes noise away."""
_LEAST_SPEED = 0.02
"""rad/s, root mean square: below it a joint is too still to say anything."""
_NOISE = 0.1
"""rad/s, root mean square: what sensors report of a joint that does not move stays below it."""
_ZERO = 0.01
"""Share of the derivative: velocities this small are none."""
_RATIO = 0.15
"""Relative error that all joints' velocities have alike: rates of 25, 30, 50, 60 and 120 are farther apart, and sensor
noise shifts it less."""
_RATIOS = (0.65, 1.25)
"""Least and largest ratio of one joint's velocities. A light joint under a command in steps jumps and settles within
each of them: sampled once a step, the speed of a simulated robot's wrists is 0.73 of their positions' derivative."""
_SLOW_RATIOS = (0.55, 1.8)
"""Likewise of a joint slower than `_NOISE`: most of what it does is that."""
_CLEAR = 0.9
"""Correlation from which on a ratio or a delay is believed."""
_POOR = 0.8
"""Correlation below which velocities are not the joint's; of whole_body_tracking's files it is 0.99."""
_NAMED = 0.05
"""Relative error of a ratio that is called by its name, such as half."""
_SHOWN = 4
"""Joints named before "and more"."""


@dataclass(frozen=True, slots=True)
class RateCheck:
    """Frame rate that the joint velocities show."""

    fps: float
    """Frames per second for which the velocities fit the positions best."""
    correlation: float
    """Between velocities and differences of positions: 1 where they agree."""


@dataclass(frozen=True, slots=True)
class VelocityCheck:
    """A joint's velocities, compared with the derivative of its positions."""

    joint: str
    ratio: float
    """Velocity over derivative: 1 where they agree."""
    correlation: float
    """Between the two; 0 if there are no velocities to compare."""
    fault: str
    """Description of what the velocities are instead; empty if nothing is wrong with them."""


def check_rate(position: FloatArray, velocity: FloatArray, fps: float) -> RateCheck | None:
    """Compare joint velocities (F, n), rad/s, with the derivatives of positions (F, n), rad.

    None for motions of less than twelve frames and for those that hardly move.
    """
    if len(position) < _LEAST_FRAMES:
        return None
    smooth = _smooth(velocity[_EDGE:-_EDGE])
    # One exporter takes all differences alike.
    rate = max(_derivatives(position, fps), key=lambda each: _compare(each.ravel(), smooth.ravel())[1])
    power, cross, own = (float((a * b).sum()) for a, b in ((rate, rate), (rate, smooth), (smooth, smooth)))
    if min(power, own) < _LEAST_SPEED**2 * rate.size:
        return None
    return RateCheck(fps * cross / power, cross / math.sqrt(power * own))


def check_velocities(
    position: FloatArray, velocity: FloatArray, fps: float, joints: Iterable[str]
) -> tuple[VelocityCheck, ...]:
    """Compare the velocities of each joint, (F, n), rad/s, with the derivative of its positions, (F, n), rad.

    Empty for motions of less than twelve frames; else the joints that move, and those that only seem to.
    """
    if len(position) < _LEAST_FRAMES:
        return ()
    smooth = _smooth(velocity[_EDGE:-_EDGE])
    checks = (_check(name, _derivatives(position[:, j], fps), smooth[:, j], fps) for j, name in enumerate(joints))
    return tuple(check for check in checks if check is not None)


def _check(joint: str, rates: list[FloatArray], velocity: FloatArray, fps: float) -> VelocityCheck | None:
    rate = _nearest(rates, velocity)
    speed, moved = _rms(velocity), _rms(rate)
    if moved < _LEAST_SPEED:
        if speed < max(_NOISE, 5.0 * moved):
            return None
        fastest = float(np.abs(velocity).max())
        return VelocityCheck(joint, math.inf, 0.0, f"up to {fastest:.2f} rad/s, and it hardly moves")
    if speed <= _ZERO * moved:
        return VelocityCheck(joint, speed / moved, 0.0, "all zero" if not velocity.any() else "all nearly zero")
    ratio, correlation = _compare(rate, velocity)
    least, most = _RATIOS if moved >= _NOISE else _SLOW_RATIOS
    fault = ""
    if _is_unlike(rate, velocity, fps):
        fault = "unlike the derivative of the positions"
    elif abs(correlation) >= _CLEAR and not least < ratio < most:
        fault = _unit(ratio, fps) or f"{ratio:.2g} times the derivative of the positions"
    return VelocityCheck(joint, ratio, correlation, fault)


def refuse_velocities(
    source: str, fps: float, rate: RateCheck | None, checks: tuple[VelocityCheck, ...], count: int
) -> None:
    """Refuse velocities that are not those of the positions; `count` is the number of the robot's joints.

    Raises `InputError` with the frame rate that they fit, or what is wrong with which joints.
    """
    faults = [check for check in checks if check.fault]
    ratios = [check.ratio for check in checks if check.correlation >= _CLEAR]
    scaled = all(check.correlation >= _CLEAR for check in faults)
    usual = float(np.median(ratios)) if ratios else 1.0
    agree = scaled and bool(ratios) and max(ratios) < (1.0 + _RATIO) * min(ratios)
    if agree and rate is not None and abs(usual - 1.0) > _RATIO and not _unit(usual, fps):
        raise InputError(f"{source}: fps is {fps:g}, but its joint velocities match {rate.fps:.1f} frames per second")
    if not faults:
        return
    joints: dict[str, list[str]] = {}
    for check in faults:
        joints.setdefault(check.fault, []).append(check.joint)
    words = "; ".join(f"{_listed(names, count)}: velocities are {fault}" for fault, names in joints.items())
    raise InputError(
        f"{source}: its joint velocities do not match its joint positions: {words}; correct them, or let --velocities "
        "positions compute them from the positions"
    )


def _listed(names: list[str], count: int) -> str:
    if len(names) == count > 1:
        return f"all {count} joints"
    if len(names) <= _SHOWN:
        return ", ".join(names)
    return f"{', '.join(names[: _SHOWN - 1])} and {len(names) - _SHOWN + 1} more"


def _unit(ratio: float, fps: float) -> str:
    """Return the unit that explains a ratio; empty if none does."""
    units = {
        180.0 / math.pi: "in degrees per second, and the positions in radians",
        math.pi / 180.0: "in radians per second, and the positions in degrees (--angle-unit deg)",
        1.0 / fps: "per frame, not per second",
    }
    return next((words for value, words in units.items() if abs(ratio / value - 1.0) < _NAMED), "")


def _derivatives(position: FloatArray, fps: float) -> list[FloatArray]:
    """Return derivatives (F - 8, …), rad/s, of positions (F, …), rad: those of exporters, and one of sixth order."""
    count = len(position) - 2 * _EDGE

    def at(offset: int) -> FloatArray:
        return position[_EDGE + offset : _EDGE + offset + count]

    # Weights of the sixth order: Fornberg 1988, "Generation of Finite Difference Formulas on Arbitrarily Spaced Grids".
    high = (45.0 * (at(1) - at(-1)) - 9.0 * (at(2) - at(-2)) + (at(3) - at(-3))) / 60.0
    steps = [0.5 * (at(1) - at(-1)), at(1) - at(0), at(0) - at(-1), high]
    return [_smooth(fps * step) for step in steps]


def _smooth(values: FloatArray, frames: int = 3) -> FloatArray:
    """Means of so many frames in a row, along the first axis: they take noise from both sides of a comparison alike."""
    total = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    mean: FloatArray = (total[frames:] - total[:-frames]) / frames
    return mean


def _nearest(rates: list[FloatArray], velocity: FloatArray) -> FloatArray:
    """Return the derivative that the velocities resemble most; of a sine they differ by a factor alone."""

    def likeness(rate: FloatArray) -> tuple[float, float]:
        ratio, correlation = _compare(rate, velocity)
        return round(abs(correlation), 4), -abs(ratio - 1.0)

    return max(rates, key=likeness)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt((values * values).mean()))


def _compare(rate: FloatArray, velocity: FloatArray) -> tuple[float, float]:
    """Return velocity over rate, and the correlation of values whose mean counts; 0 where they are 0 throughout."""
    power, cross = float(rate @ rate), float(rate @ velocity)
    both = power * float(velocity @ velocity)
    return cross / power if power > 0.0 else 0.0, cross / math.sqrt(both) if both > 0.0 else 0.0


def _is_unlike(rate: FloatArray, velocity: FloatArray, fps: float) -> bool:
    frames = max(1, min(round(_CALM * fps), len(rate) // 4))
    calm, own = _smooth(rate, frames), _smooth(velocity, frames)
    return _rms(calm) >= _NOISE and abs(_compare(calm, own)[1]) < _POOR
