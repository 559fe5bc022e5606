"""Tracking of a motion by a run: errors of the bodies, or of joints and anchor body, accumulated frame by frame.

The convention is strict: the error of frame k is the pose that was read in the very tick in which the policy was shown
frame k, minus frame k. Nothing is shifted in time. A motion ends with its last frame, which counts once: what a policy
does with it while it is held is not an error of the motion. What is kept does not grow with the length of the run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.controllers.rotation import rotation_angle
from humanoid_sim.evaluation.errors import length, pose_error
from humanoid_sim.mit import ANCHOR_POSE, FloatArray, MITState
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion, body_poses
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import ForwardKinematics


class _Errors:
    """Errors of a run until its motion is over, although its last frame is still shown; a single one never is over."""

    latest: FloatArray | None = None
    """Errors of the latest policy step; None before any, and once the motion is over."""

    def __init__(self, frame_count: int, shape: tuple[int, ...]) -> None:
        self._last, self._is_last_shown = frame_count - 1, False
        self._sum, self._largest = np.zeros(shape), np.zeros(shape)
        self._samples = 0

    def _is_over(self, frame: int) -> bool:
        """Return whether the last frame was shown before; asked in every policy step."""
        was_shown, self._is_last_shown = self._is_last_shown, frame >= self._last > 0
        return was_shown and self._is_last_shown

    def _add(self, error: FloatArray, summand: FloatArray) -> None:
        self.latest = error
        self._sum += summand
        np.maximum(self._largest, error, out=self._largest)
        self._samples += 1


@dataclass(frozen=True, slots=True)
class BodyError:
    """Errors of one body, or of several taken together."""

    name: str
    position_rms: float
    """m; NaN if nothing was measured, as all the others."""
    position_max: float
    """m"""
    orientation_rms: float
    """rad"""
    orientation_max: float
    """rad"""


@dataclass(frozen=True, slots=True)
class TrackingSummary:
    """Errors of a run."""

    samples: int
    """Policy steps that were measured."""
    peak_speed: float
    """m/s, the fastest that the reference moves a hand."""
    hands: BodyError
    """The root mean square is over frames and hands."""
    bodies: tuple[BodyError, ...]
    """In the motion's order."""


class TrackingErrors(_Errors):
    """Accumulates the errors of a run. The hands are the description's; where a motion holds none, all its bodies.

    The latest ones are (B, 2), m and rad.
    """

    def __init__(
        self,
        description: RobotDescription,
        frames: npt.NDArray[np.floating],
        body_names: tuple[str, ...],
        policy_dt: float,
    ) -> None:
        """Look the bodies up. Raises `InputError` if the robot lacks one.

        Args:
            frames: shape (F, 9 B), tracking frames `[positions 3 B | orientations 6 B]`, m, base frame.
            body_names: the B bodies.
            policy_dt: s between two frames.
        """
        count = len(body_names)
        super().__init__(len(frames), (count, 2))
        self._kinematics = ForwardKinematics(description, body_names)
        self.names = body_names
        hands = [i for i, name in enumerate(body_names) if name in description.hands]
        self._hands = hands or list(range(count))
        self._position, self._rotation = body_poses(frames, count)
        self._peak_speed = peak_speed(self._position[:, self._hands], policy_dt)

    def update(self, frame: int, joint_position: FloatArray) -> None:
        """Take a policy step: the frame it was shown, and joint positions in that tick, (n,), rad, joint frame."""
        if self._is_over(frame):
            self.latest = None
            return
        position, rotation = self._kinematics(joint_position)
        k = min(frame, len(self._position) - 1)
        error = np.stack([length(position - self._position[k]), rotation_angle(rotation, self._rotation[k])], axis=-1)
        self._add(error, error * error)

    def summary(self) -> TrackingSummary:
        """Return the errors so far."""
        bodies = tuple(self._error(name, [i]) for i, name in enumerate(self.names))
        return TrackingSummary(self._samples, self._peak_speed, self._error("hands", self._hands), bodies)

    def _error(self, name: str, rows: list[int]) -> BodyError:
        if not self._samples:
            return BodyError(name, *[float("nan")] * 4)
        rms = np.sqrt(self._sum[rows].sum(axis=0) / (self._samples * len(rows)))
        largest = self._largest[rows].max(axis=0)
        return BodyError(name, float(rms[0]), float(largest[0]), float(rms[1]), float(largest[1]))


def peak_speed(position: npt.NDArray[np.floating], period: float) -> float:
    """m/s, the largest difference quotient of points of shape (F, B, 3), m, `period` s apart; 0 for a single frame."""
    return float(length(np.diff(position, axis=0)).max(initial=0.0)) / period


@dataclass(frozen=True, slots=True)
class AnchorSummary:
    """Errors over the policy steps of a run; of each, the mean and the greatest."""

    samples: int
    joint_error: tuple[float, float]
    """rad, of the mean over the joints."""
    anchor_position: tuple[float, float]
    """m"""
    anchor_angle: tuple[float, float]
    """rad"""


class AnchorErrors(_Errors):
    """Accumulates errors against the reference, laid onto the robot as the policy's own was at activation.

    The latest ones are (3,): rad, of the mean over the joints, m and rad of the anchor body; None too while nobody
    knows how the reference was laid onto the robot.
    """

    def __init__(
        self, reference: MotionReference, joint_names: tuple[str, ...], robot_joints: tuple[str, ...], *, align: bool
    ) -> None:
        """Look the policy's joints up; `robot_joints` orders the state's arrays.

        The reference has joint positions and anchor poses; with `align` it is laid onto the robot.
        """
        super().__init__(reference.frame_count, (3,))
        self._reference = reference
        self._order = joint_indices(joint_names, robot_joints, "joint_names of the policy")
        self._align = align
        self._alignment: Alignment | None = None

    def update(self, frame: int, state: MITState) -> None:
        """Compare the state of a policy step with the frame that it was shown."""
        live = state.extern.get(ANCHOR_POSE)
        if live is None or self._is_over(frame):
            self.latest = None
            return
        pose = live.value
        if frame == 0 and self._align:
            self._alignment = self._reference.align(pose)
        if self._align and self._alignment is None:
            return  # the beginning was not seen
        joints = self._reference.term("reference_joint_pos", frame)
        posed = pose_error(pose, *self._reference.anchor(frame, self._alignment))
        error = np.array([np.abs(state.joint_position[self._order] - joints).mean(), posed.distance, posed.angle])
        self._add(error, error)

    def summary(self) -> AnchorSummary | None:
        """Return the errors so far; None if nothing was compared."""
        if not self._samples:
            return None
        joint, position, angle = (
            (float(mean), float(most)) for mean, most in zip(self._sum / self._samples, self._largest, strict=True)
        )
        return AnchorSummary(self._samples, joint, position, angle)


def errors_of_run(
    description: RobotDescription, loaded: LoadedPolicy, motion: Motion | None
) -> tuple[TrackingErrors | None, AnchorErrors | None]:
    """Return what measures how well a motion is followed: bodies in the base frame, or joints and an anchor."""
    tracking = anchor = None
    reference, contract = loaded.reference, loaded.contract
    if "motion_body_pos_b" in reference.terms and motion is not None:
        tracking = TrackingErrors(description, motion.frames, contract.body_names, contract.policy_dt)
    if "anchor_pos" in reference.terms:
        anchor = AnchorErrors(reference, contract.joint_names, description.joint_names, align=contract.align_reference)
    return tracking, anchor
