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

__all__ = ["RateCheck", "VelocityCheck", "check_rate", "check_velocities", "faults_in_words", "refuse_velocities"]

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
"""Of the derivative: velocities this small are none."""
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
_OTHER = 0.98
"""Correlation from which on they are another joint's."""
_FILTER = 2
"""Frames by which a filter that smooths measured velocities may delay them."""
_MOST_LAG = 60
"""frames"""
_LEAST_ERROR = 0.01
"""Squared relative error below which no delay is sought: of a joint at constant speed every delay fits."""
_BETTER = 0.25
"""What a delay must leave of the squared error."""
_NAMED = 0.05
"""Relative error of a ratio that is called by its name, such as half."""
_SHOWN = 4
"""Joints named before "and more"."""


@dataclass(frozen=True, slots=True)
class RateCheck:
    """What the joint velocities say about the frame rate."""

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
    lag: int
    """Frames by which the velocities come late; negative if early."""
    correlation: float
    """Between the two at this lag; 0 if there are no velocities to compare."""
    fault: str
    """What the velocities are instead; empty if nothing is wrong with them."""


def check_rate(position: FloatArray, velocity: FloatArray, fps: float) -> RateCheck | None:
    """Compare joint velocities (F, n), rad/s, with the derivatives of positions (F, n), rad.

    Returns:
        None for motions of less than twelve frames and for those that hardly move.
    """
    if len(position) < _LEAST_FRAMES:
        return None
    smooth = _smooth(velocity[_EDGE:-_EDGE])
    # One exporter takes all differences alike.
    rate = max(_derivatives(position, fps), key=lambda each: _correlation(each.ravel(), smooth.ravel()))
    power, cross, own = (float((a * b).sum()) for a, b in ((rate, rate), (rate, smooth), (smooth, smooth)))
    if min(power, own) < _LEAST_SPEED**2 * rate.size:
        return None
    return RateCheck(fps * cross / power, cross / math.sqrt(power * own))


def check_velocities(
    position: FloatArray, velocity: FloatArray, fps: float, joints: Iterable[str]
) -> tuple[VelocityCheck, ...]:
    """Compare the velocities of each joint, (F, n), rad/s, with the derivative of its positions, (F, n), rad.

    Returns:
        Empty for motions of less than twelve frames; else the joints that move, and those that only seem to.
    """
    if len(position) < _LEAST_FRAMES:
        return ()
    names = tuple(joints)
    smooth = _smooth(velocity[_EDGE:-_EDGE])
    rates = [_derivatives(position[:, j], fps) for j in range(len(names))]
    checks = (_check(names, j, rates, smooth, fps) for j in range(len(names)))
    return tuple(check for check in checks if check is not None)


def _check(
    names: tuple[str, ...], joint: int, rates: list[list[FloatArray]], velocity: FloatArray, fps: float
) -> VelocityCheck | None:
    own, rate = velocity[:, joint], _nearest(rates[joint], velocity[:, joint])
    speed, moved = _rms(own), _rms(rate)
    name = names[joint]
    if moved < _LEAST_SPEED:
        if speed < max(_NOISE, 5.0 * moved):
            return None
        return VelocityCheck(name, math.inf, 0, 0.0, f"up to {np.abs(own).max():.2f} rad/s, and it hardly moves")
    if speed <= _ZERO * moved:
        words = "all zero" if not own.any() else "all nearly zero"
        return VelocityCheck(name, speed / moved, 0, 0.0, words)
    lag = _lag(rates[joint], own)
    same = _shifted(rates[joint][0] if lag else rate, own, lag)
    correlation, ratio = _correlation(*same), _ratio(*same)
    fault = ""
    unlike = _is_unlike(rate, own, fps)
    other = _other(rates, own, joint, correlation) if lag or unlike else None
    if other is not None:
        return VelocityCheck(name, ratio, 0, _correlation(rate, own), f"those of {names[other]}")
    if lag:
        fault = f"{abs(lag)} frames {'late' if lag > 0 else 'early'}"
    elif unlike:
        fault = "unlike the derivative of the positions"
    least, most = _RATIOS if moved >= _NOISE else _SLOW_RATIOS
    if abs(correlation) >= _CLEAR and not least < ratio < most:
        fault += (", and " if fault else "") + _ratio_in_words(ratio, fps)
    return VelocityCheck(name, ratio, lag, correlation, fault)


def refuse_velocities(
    source: str, fps: float, rate: RateCheck | None, checks: tuple[VelocityCheck, ...], count: int
) -> None:
    """Refuse velocities that are not those of the positions; `count` is the number of the robot's joints.

    Raises:
        InputError: with the frame rate that they fit, or what is wrong with which joints.
    """
    faults = [check for check in checks if check.fault]
    ratios = [check.ratio for check in checks if check.correlation >= _CLEAR]
    scaled = all(check.correlation >= _CLEAR and not check.lag for check in faults)
    usual = float(np.median(ratios)) if ratios else 1.0
    agree = scaled and bool(ratios) and max(ratios) < (1.0 + _RATIO) * min(ratios)
    if agree and rate is not None and abs(usual - 1.0) > _RATIO and not _unit(usual, fps):
        raise InputError(f"{source}: fps is {fps:g}, but its joint velocities match {rate.fps:.1f} frames per second")
    if not faults:
        return
    raise InputError(
        f"{source}: its joint velocities do not match its joint positions: {faults_in_words(faults, count)}; correct "
        "them, or let --velocities positions compute them from the positions"
    )


def faults_in_words(faults: list[VelocityCheck], count: int) -> str:
    """Each fault once, after the joints that have it; `count` is the number of the robot's joints."""
    joints: dict[str, list[str]] = {}
    for check in faults:
        joints.setdefault(check.fault, []).append(check.joint)
    return "; ".join(f"{_listed(names, count)}: velocities are {fault}" for fault, names in joints.items())


def _listed(names: list[str], count: int) -> str:
    if len(names) == count > 1:
        return f"all {count} joints"
    if len(names) <= _SHOWN:
        return ", ".join(names)
    return f"{', '.join(names[: _SHOWN - 1])} and {len(names) - _SHOWN + 1} more"


def _unit(ratio: float, fps: float) -> str:
    """The unit that explains a ratio; empty if none does."""
    units = {
        180.0 / math.pi: "in degrees per second, and the positions in radians",
        math.pi / 180.0: "in radians per second, and the positions in degrees (--angle-unit deg)",
        1.0 / fps: "per frame, not per second",
    }
    return next((words for value, words in units.items() if abs(ratio / value - 1.0) < _NAMED), "")


def _ratio_in_words(ratio: float, fps: float) -> str:
    named = {0.5: "half of", 2.0: "twice", -1.0: "the negative of"}
    times = next((words for value, words in named.items() if abs(ratio / value - 1.0) < _NAMED), f"{ratio:.2g} times")
    return _unit(ratio, fps) or f"{times} the derivative of the positions"


def _derivatives(position: FloatArray, fps: float) -> list[FloatArray]:
    """Derivatives (F - 8, …), rad/s, of positions (F, …), rad, smoothed: those of exporters, and one of sixth order."""
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
    """The derivative that the velocities resemble most; of a sine they differ by a factor alone."""

    def likeness(rate: FloatArray) -> tuple[float, float]:
        return round(abs(_correlation(rate, velocity)), 4), -abs(_ratio(rate, velocity) - 1.0)

    return max(rates, key=likeness)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt((values * values).mean()))


def _ratio(rate: FloatArray, velocity: FloatArray) -> float:
    power = float(rate @ rate)
    return float(rate @ velocity) / power if power > 0.0 else 0.0


def _correlation(rate: FloatArray, velocity: FloatArray) -> float:
    """Of values whose mean counts; 0 where one of them is 0 throughout."""
    power = float(rate @ rate) * float(velocity @ velocity)
    return float(rate @ velocity) / math.sqrt(power) if power > 0.0 else 0.0


def _shifted(rate: FloatArray, velocity: FloatArray, lag: int) -> tuple[FloatArray, FloatArray]:
    """The frames that both have where the velocities come `lag` frames late."""
    count = len(rate) - abs(lag)
    return rate[max(-lag, 0) :][:count], velocity[max(lag, 0) :][:count]


def _lag(rates: list[FloatArray], velocity: FloatArray) -> int:
    """The delay of the velocities in frames; without clear evidence 0."""
    most = min(_MOST_LAG, len(velocity) // 3)

    def error(rate: FloatArray, lag: int) -> float:
        return 1.0 - max(_correlation(*_shifted(rate, velocity, lag)), 0.0) ** 2

    # A filter's delay is no mistake, and the opposite sign explains what half a period's delay would.
    usual = min(error(rate, lag) for rate in rates for lag in range(-_FILTER, _FILTER + 1))
    errors = {lag: error(rates[0], lag) for lag in range(-most, most + 1)}
    least = min(errors.values())
    opposite = 1.0 - min(_correlation(rates[0], velocity), 0.0) ** 2
    if usual <= _LEAST_ERROR or opposite <= _LEAST_ERROR or least > min(_BETTER * usual, 1.0 - _CLEAR**2):
        return 0
    # What repeats itself fits again a period later: the shortest delay among those that fit alike.
    alike = [lag for lag in errors if errors[lag] <= 2.0 * least + 0.1 * _LEAST_ERROR]
    shortest = min(alike, key=abs)
    return min((lag for lag in alike if abs(lag - shortest) <= _FILTER), key=lambda lag: errors[lag])


def _is_unlike(rate: FloatArray, velocity: FloatArray, fps: float) -> bool:
    frames = max(1, min(round(_CALM * fps), len(rate) // 4))
    calm, own = _smooth(rate, frames), _smooth(velocity, frames)
    return _rms(calm) >= _NOISE and abs(_correlation(calm, own)) < _POOR


def _other(rates: list[list[FloatArray]], velocity: FloatArray, joint: int, correlation: float) -> int | None:
    """The other joint whose velocities these are, by more than their own joint's correlation; None if there is none."""
    fits = [0.0 if j == joint else max(_correlation(rate, velocity) for rate in rates[j]) for j in range(len(rates))]
    best = int(np.argmax(fits))
    return best if fits[best] > max(_OTHER, correlation) else None
