"""Figures of a run, accumulated tick by tick: `play`'s final table and `record info` are made of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from humanoid_sim.controllers.fsm import describe_safety, merge_safety
from humanoid_sim.controllers.reference import Alignment
from humanoid_sim.controllers.rotation import quaternion_from_matrix
from humanoid_sim.evaluation.step import StepContext, StepSample
from humanoid_sim.evaluation.step_metrics import METRICS, describe_fall, has_fallen, rms
from humanoid_sim.messages import Event, TickRecord
from humanoid_sim.mit import ANCHOR_POSE, KEY_PRESSED, FloatArray, MITState
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import BaseObserver
from humanoid_sim.simulation.kinematics import ForwardKinematics

REMARKS = ("events", "faults", "refusals", "safety")
_SETTLING = 2.0  # s after release that the mean velocity leaves out: the robot starts from rest
_KEPT = 1000  # newest modes, events, faults, refusals and safety statuses
_NEWEST = 100_000  # ticks whose durations are kept
_OF_BODIES = "body_position_error", "body_orientation_error", "hand_position_error", "hand_orientation_error"
_OF_ANCHOR = "joint_error", "anchor_position_error", "anchor_orientation_error"
_OF_SONG = "precision", "recall", "f1"


class MotionFigures:
    """Rows of `step_metrics` over a run that follows a motion: of bodies, of joints and an anchor body, or of a song.

    A figure of frame k is of the very tick in which the policy was shown frame k. The last frame counts once: what a
    policy does while it is held is not of the motion.
    """

    def __init__(self, description: RobotDescription, loaded: LoadedPolicy) -> None:
        """Prepare. Raises `InputError` if the robot lacks a body of the motion."""
        self._context = StepContext(description, loaded.contract, loaded.reference)
        bodies = self._context.tracked
        self._kinematics = ForwardKinematics(description, bodies) if bodies else None
        self._names: tuple[str, ...] = _OF_BODIES if bodies else ()
        self._live = ""  # live input without which there are no figures
        if "target_keys" in loaded.reference.terms:
            self._names, self._live = _OF_SONG, KEY_PRESSED
        elif "motion with an anchor" in self._context.parts and not bodies:
            self._names, self._live = _OF_ANCHOR, ANCHOR_POSE
        self._samples: list[FloatArray] = []
        self._is_last_shown = False
        self._alignment: Alignment | None = None

    def update(self, frame: int, state: MITState) -> None:
        """Compare the state of the tick in which the policy was shown a frame."""
        reference, live = self._context.reference, state.extern
        was_shown, self._is_last_shown = self._is_last_shown, frame >= reference.frame_count - 1 > 0
        if not self._names or (was_shown and self._is_last_shown) or (self._live and self._live not in live):
            return
        sample = StepSample(state, frame)
        if self._kinematics is not None:
            position, rotation = self._kinematics(state.joint_position)
            sample = StepSample(state, frame, body_position=position, body_quaternion=quaternion_from_matrix(rotation))
        elif self._live == ANCHOR_POSE and self._context.contract.align_reference:
            if frame == 0:
                self._alignment = reference.align(live[ANCHOR_POSE].value)
            if self._alignment is None:
                return
            sample = StepSample(state, frame, alignment=self._alignment)
        self._samples.append(np.array([METRICS[name].values(self._context, sample) for name in self._names]))

    def summary(self) -> dict[str, Any]:
        """Return the figures so far, JSON; None where nothing was compared.

        `tracking` has the number of samples, and by error its unit, mean, rms and maximum; `piano` the scores' means.
        """
        figures: dict[str, Any] = {"tracking": None, "piano": None}
        rows = dict(zip(self._names, np.array(self._samples).T, strict=False))
        if rows and self._live == KEY_PRESSED:
            figures["piano"] = {name: float(values.mean()) for name, values in rows.items()}
        elif rows:
            errors = {}
            for name, values in rows.items():
                found = {"mean": float(values.mean()), "rms": float(rms(values)), "max": float(values.max())}
                errors[name] = {"unit": METRICS[name].unit, **found}
            figures["tracking"] = {"samples": len(self._samples), "errors": errors}
        return figures


class RunFigures:
    """Modes, faults, refusals, tick times and efforts of a run; of simulated ones also falls, speed, errors, song."""

    def __init__(
        self,
        robot: RobotDescription,
        *,
        motion: MotionFigures | None = None,
        base: BaseObserver | None = None,
    ) -> None:
        """Start empty; `base` sees the floating base of a simulated robot."""
        self._robot, self._motion, self._base = robot, motion, base
        self.modes: deque[dict[str, Any]] = deque(maxlen=_KEPT)
        self.remarks: dict[str, deque[dict[str, Any]]] = {kind: deque(maxlen=_KEPT) for kind in REMARKS}
        self.ticks = self.missing = self.overruns = self.inferences = 0
        self.time = 0.0
        self._durations: deque[float] = deque(maxlen=_NEWEST)  # s
        self._effort: FloatArray = np.zeros(robot.joint_count)  # N·m, largest magnitudes
        self._safety = ""
        self._released: float | None = None  # s, robot's clock
        self._standing_height = 0.0  # m, of the centre of mass
        self._fall: float | None = None  # s after release
        self._fell = ""
        self._speed, self._moving = np.zeros(3), 0

    def tick(self, record: TickRecord) -> str:
        """Take one tick into account; returns how the robot fell in the tick in which it does, else ''."""
        state, output, control = record.input.state, record.output, record.output.control_mode
        self.time = time = float(state.time)
        self.missing = record.index - self.ticks
        self.ticks += 1
        self.overruns += record.overrun
        self._durations.append(record.duration)
        np.fmax(self._effort, np.abs(state.joint_effort), out=self._effort)
        if not self.modes or self.modes[-1]["controller"] != control.controller_name:
            names = {"mode": control.mode.name, "controller": control.controller_name, "reason": control.status_message}
            self.modes.append({**names, "start": time})
        self.modes[-1]["end"] = time
        self._remark("faults", time, [f"{fault.controller}: {fault.message}" for fault in output.faults])
        self._remark("refusals", time, output.refusals)
        merged = merge_safety(record.input.safety)
        safety = "" if merged.is_ok else describe_safety(merged)
        if safety != self._safety:
            self._safety = safety
            self._remark("safety", time, [safety] if safety else [])
        if output.policy_step is not None:
            self.inferences += 1
            if self._motion is not None:
                self._motion.update(output.policy_step.frame, state)
        if record.qpos is not None and control.mode.is_free:
            return self._watch_base(state, record.qpos)
        return ""

    def event(self, event: Event) -> None:
        self._remark("events", event.time, [event.text])

    def _remark(self, kind: str, time: float, messages: Sequence[str]) -> None:
        self.remarks[kind] += [{"time": time, "message": message} for message in messages]

    def _watch_base(self, state: MITState, qpos: FloatArray) -> str:
        if self._base is None or self._fall is not None:
            return ""
        if self._released is None:
            self._released, self._standing_height = float(state.time), self._base.standing_height(qpos)
        base, since = self._base.sensed(state, qpos), float(state.time) - self._released
        if has_fallen(base, self._standing_height):
            self._fall, self._fell = since, describe_fall(base, self._standing_height)
        elif since >= _SETTLING:
            self._speed, self._moving = self._speed + base.planar_velocity, self._moving + 1
        return self._fell

    def summary(self) -> dict[str, Any]:
        """Return the figures, JSON, in SI units and radians; times in s on the robot's clock."""
        limits = self._robot.effort_limit.tolist()
        rows = zip(self._robot.joint_names, self._effort.tolist(), limits, strict=True)
        efforts = [{"joint": name, "peak": peak, "limit": limit} for name, peak, limit in rows]
        base = None
        if self._released is not None:
            mean = (self._speed / self._moving).tolist() if self._moving else None  # m/s forward, to the left; rad/s
            base = {"released": self._released, "velocity": mean, "fall": self._fall, "fell": self._fell}
        return {
            "modes": list(self.modes),
            **{kind: list(remarks) for kind, remarks in self.remarks.items()},
            "tick_time": spread(self._durations),
            "inferences": self.inferences,
            "effort": sorted(efforts, key=lambda row: row["peak"] / row["limit"], reverse=True),
            "base": base,
            **({"tracking": None, "piano": None} if self._motion is None else self._motion.summary()),
        }


def spread(seconds: Collection[float]) -> dict[str, float] | None:
    """Return median, 99th percentile and maximum of durations, s; None of none."""
    if not len(seconds):
        return None
    median, p99 = np.percentile(np.array(seconds), (50.0, 99.0)).tolist()
    return {"median": median, "p99": p99, "max": max(seconds)}
