"""The sample motions: wave, two-hand circle, reach and drum, and the smooth paths that all motions are made of.

Each starts and ends in standby pose A, at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.motion import Motion, body_frames, write_motion
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics, InverseKinematics
from tools.samples.arm import JOINT_SIGN

__all__ = [
    "BODIES",
    "POLICY_DT",
    "SAMPLES",
    "SAMPLE_DATASET",
    "derivative",
    "ease",
    "joint_frames",
    "minimum_jerk_path",
    "pose_a",
    "sample_motion",
    "smooth",
    "write_samples",
]

BODIES = ("left_elbow_pitch", "left_hand", "right_elbow_pitch", "right_hand")
"""Tracked bodies: where the elbows and the hands are, and how they are turned, determines all 14 joints."""

POLICY_DT = 0.02
"""s between two frames."""

SAMPLE_DATASET = "local/lite_sample_motions"
"""Data set that the sample policy names: no hub has it, the motions ship with the package."""

_HANDS = ("left_hand", "right_hand")

_TURN = 3.0
"""rad per metre to the left, about the vertical: how hands that keep to a Cartesian path turn."""
_TILT = 2.0
"""rad per metre upwards, fingers up."""


def pose_a(description: RobotDescription) -> FloatArray:
    """Return final pose of standby A, shape (n,), rad: where motions start and end."""
    return np.array(description.standby_controller_a.pose_segments[-1])


def joint_frames(description: RobotDescription, path: FloatArray) -> npt.NDArray[np.float32]:
    """Tracking frames (F, 9 B), float32, of a joint path (F, n), rad: poses of `BODIES` in the base frame."""
    return body_frames(*ForwardKinematics(description, BODIES)(path)).astype(np.float32)


def sample_motion(description: RobotDescription, name: str) -> tuple[Motion, FloatArray]:
    """Return a sample motion by name, and the joint path (F, n), rad, that it was made from."""
    path = SAMPLES[name](description)
    return Motion(joint_frames(description, path), BODIES, POLICY_DT, "tracking", description.name), path


def write_samples(folder: Path) -> None:
    """Write every sample motion as an .mcap file; the folder is made if it is missing.

    Raises `InputError` if it cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from None
    description = load_robot("lite")
    for name in SAMPLES:
        motion, _ = sample_motion(description, name)
        write_motion(folder / f"{name}.mcap", motion)
        print(f"{folder / name}.mcap: {len(motion.frames)} frames, {motion.duration:g} s")


def _wave(description: RobotDescription) -> FloatArray:
    """Raise the right hand beside the head and wave, from the elbow, with a little of the wrist."""
    home = pose_a(description)
    left, right = home[:7], home[7:]
    # Arm out to the side and down a little, forearm up, palm to the front.
    raised = JOINT_SIGN * np.array([-1.45, -0.35, 0.0, -1.55, 0.0, 0.0, 0.0])
    path = minimum_jerk_path(
        np.array([0.0, 0.3, 1.7, 6.1, 7.5, 8.0]), _stack(right, right, raised, raised, right, right), POLICY_DT
    )
    t = np.arange(len(path)) * POLICY_DT
    # In and out gently, so that the wave has no first jerk.
    envelope = ease((t - 1.5) / 0.8) * ease((6.3 - t) / 0.8)
    swing = np.sin(2.0 * np.pi * 1.15 * (t - 1.5)) * envelope
    path[:, 3] += 0.48 * swing
    path[:, 6] += 0.15 * JOINT_SIGN[6] * swing
    # The other arm is alive too: it gives way a little to the raised one.
    side = np.repeat(left[None], len(t), axis=0)
    side[:, :4] += (ease((t - 0.4) / 1.5) * ease((7.6 - t) / 1.5))[:, None] * np.array([0.12, -0.06, 0.0, 0.15])
    return np.concatenate([side, path], axis=1)


def _circle(description: RobotDescription) -> FloatArray:
    """Both hands draw circles in front of the chest, mirrored, in the plane that the robot looks at."""
    duration, radius, turns = 8.0, 0.105, 5.0
    t = np.arange(round(duration / POLICY_DT) + 1) * POLICY_DT
    # Four fifths of the time at constant speed: `ease` alone would be twice as fast in the middle.
    angle = 2.0 * np.pi * turns * _steady(t, 0.9, duration - 0.9, ramp=1.2)
    size = ease(t / 1.6) * ease((duration - t) / 1.6)
    offset = np.zeros((len(t), 2, 3))
    shift = np.array([0.05, 0.03, 0.10])
    for side, sign in enumerate((1.0, -1.0)):
        offset[:, side] = size[:, None] * (
            shift * [1.0, sign, 1.0]
            + radius * np.stack([np.zeros_like(t), sign * np.sin(angle), -np.cos(angle)], axis=-1)
        )
    return _hand_path(description, offset)


def _reach(description: RobotDescription) -> FloatArray:
    """Return the hands reach by turns for points around the workspace, and together at the end."""
    rest = np.zeros(3)
    forward, high, low, side = (
        np.array([0.15, 0.02, 0.13]),
        np.array([0.10, 0.06, 0.32]),
        np.array([0.13, -0.07, 0.02]),
        np.array([0.06, 0.16, 0.16]),
    )
    left = [(0.3, rest), (1.1, forward), (1.5, forward), (2.3, high), (3.0, high), (3.9, rest), (6.0, rest)]
    left += [(6.9, side), (7.3, side), (8.2, low), (8.5, low), (9.2, rest), (9.6, rest)]
    right = [(1.6, rest), (2.5, side), (3.2, side), (4.0, low), (4.5, low), (5.4, high), (5.9, high)]
    right += [(6.9, side), (7.3, side), (8.2, low), (8.5, low), (9.2, rest), (9.6, rest)]
    offset = []
    for points in (left, right):
        times = np.array([0.0, *(time for time, _ in points)])
        offset.append(minimum_jerk_path(times, np.stack([rest, *(point for _, point in points)]), POLICY_DT))
    return _hand_path(description, np.stack(offset, axis=1) * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]]))


def _drum(description: RobotDescription) -> FloatArray:
    """Beat with the hands by turns on a table that is not there, faster and faster."""
    duration = 7.0
    t = np.arange(round(duration / POLICY_DT) + 1) * POLICY_DT
    envelope = ease((t - 0.3) / 1.0) * ease((duration - 0.3 - t) / 1.0)
    # The beat rises from 1.0 to 1.7 Hz; its phase is the integral.
    phase = 2.0 * np.pi * (1.0 * t + 0.05 * t * t)
    path = np.repeat(pose_a(description)[None], len(t), axis=0)
    for first, shift in ((0, 0.0), (7, np.pi)):
        beat = 0.5 * (1.0 - np.cos(phase + shift)) * envelope
        lift = np.array([-0.16, 0.0, 0.0, -0.50, 0.0, 0.0, 0.0])
        path[:, first : first + 7] += beat[:, None] * lift
        path[:, first + 6] += 0.25 * (JOINT_SIGN[6] if first else 1.0) * np.sin(phase + shift) * envelope
    return path


SAMPLES: dict[str, Callable[[RobotDescription], FloatArray]] = {
    "wave": _wave,
    "circle": _circle,
    "reach": _reach,
    "drum": _drum,
}
"""Joint paths (F, n), rad, one row per `POLICY_DT`, by name."""


def _hand_path(description: RobotDescription, offset: FloatArray) -> FloatArray:
    """Joint path (F, n), rad, on which the hands leave pose A's place by (F, 2, 3), m, base frame.

    They turn a little with the arm as they go, which keeps the wrists away from their limits.
    """
    home = pose_a(description)
    position, rotation = ForwardKinematics(description, _HANDS)(home)
    yaw, pitch = _TURN * offset[..., 1], -_TILT * offset[..., 2]
    rotations = _about(2, yaw) @ _about(1, pitch) @ rotation
    solver = InverseKinematics(description, _HANDS, damping=0.02)
    return solver.solve_path(position + offset, rotations, home, posture=home)


def _about(axis: int, angle: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) about a coordinate axis by angles (...), rad."""
    turned = np.zeros((*angle.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned[..., axis, axis] = 1.0
    turned[..., i, i] = turned[..., j, j] = np.cos(angle)
    turned[..., j, i] = np.sin(angle)
    turned[..., i, j] = -turned[..., j, i]
    return turned


def _steady(t: npt.NDArray[np.floating], start: float, stop: float, ramp: float) -> FloatArray:
    """Rises from 0 to 1 at a speed that itself eases in and out over `ramp` seconds, and is constant in between."""
    speed = ease((t - start) / ramp) * ease((stop - t) / ramp)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    progress: FloatArray = travelled / travelled[-1]
    return progress


def _stack(*points: FloatArray) -> FloatArray:
    return np.stack(points)


def ease(phase: npt.ArrayLike) -> FloatArray:
    """Minimum jerk: rises from 0 at phase 0 to 1 at phase 1, at rest at both ends; constant outside."""
    s = np.clip(np.asarray(phase, dtype=np.float64), 0.0, 1.0)
    risen: FloatArray = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    return risen


def minimum_jerk_path(times: FloatArray, points: FloatArray, period: float) -> FloatArray:
    """From point to point, at rest at each of them.

    Args:
        times: shape (k,), s, increasing from 0; two equal points in a row are a pause.
        points: shape (k, n).
        period: s between samples.

    Returns:
        Shape (F, n), from time 0 to the last one inclusive.
    """
    t = np.arange(round(times[-1] / period) + 1) * period
    path = np.repeat(points[:1], len(t), axis=0)
    for start, stop, step in zip(times[:-1], times[1:], np.diff(points, axis=0), strict=True):
        path = path + ease((t - start) / (stop - start))[:, None] * step
    return path


def smooth(path: FloatArray, window: int) -> FloatArray:
    """Return a path (F, n) averaged under a Hann window of `window` samples; it stays where it is beyond its ends."""
    weights = np.hanning(window + 2)[1:-1]
    weights /= weights.sum()
    padded = np.concatenate([np.repeat(path[:1], window, axis=0), path, np.repeat(path[-1:], window, axis=0)])
    averaged = np.stack([np.convolve(column, weights, mode="same") for column in padded.T], axis=-1)
    return averaged[window:-window]


def derivative(path: FloatArray, period: float) -> FloatArray:
    """Central differences along the first axis of (F, ...), one-sided at the ends, per second."""
    rate: FloatArray = np.gradient(path, period, axis=0)
    return rate
