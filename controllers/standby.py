"""STANDBY: go from the present positions through a sequence of poses, gains ramped in during the first segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.parameters import time_problem
from humanoid_sim.messages import StandbyState, TickInput
from humanoid_sim.mit import FloatArray, MITCommand, MITState, frozen_array

_LONGEST_STEP = 0.05  # s of trajectory that one tick may cover: after a stall of the host the arms do not jump


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StandbyMemory(Memory):
    """Start of the trajectory, and the progress along it."""

    start: FloatArray  # shape (n,), rad, the positions captured at activation
    elapsed: float  # s of trajectory
    time: float  # s, robot's clock at the previous tick


@dataclass(frozen=True, slots=True, eq=False)
class StandbyController:
    """Linear interpolation through pose segments; K_p and K_d rise from 0 to their targets during segment 0.

    It is finished when the *command* is at the final pose and gains: under gravity the joints sag below it for ever.
    """

    joints: tuple[str, ...]
    target_stiffness: FloatArray  # shape (n,), N·m/rad
    target_damping: FloatArray  # shape (n,), N·m·s/rad
    segment_durations: FloatArray  # shape (s,), s, each > 0
    pose_segments: FloatArray  # shape (s, n), rad, the pose at the end of each segment

    def __post_init__(self) -> None:
        for name in ("target_stiffness", "target_damping", "segment_durations", "pose_segments"):
            object.__setattr__(self, name, frozen_array("StandbyController", name, getattr(self, name)))

    def activate(self, tick_input: TickInput) -> StandbyMemory | Fault:
        """Capture the positions; every joint must be known, because from here on every joint is driven."""
        state = tick_input.state
        if problem := self._problem(state):
            return Fault(problem)
        standby = StandbyState(0, len(self.segment_durations), 0.0, False)
        return StandbyMemory(standby=standby, start=state.joint_position, elapsed=0.0, time=float(state.time))

    def update(self, memory: StandbyMemory, tick_input: TickInput) -> tuple[StandbyMemory, MITCommand] | Fault:
        if problem := self._problem(tick_input.state):
            return Fault(problem)
        time = float(tick_input.state.time)
        elapsed = memory.elapsed + min(max(time - memory.time, 0.0), _LONGEST_STEP)
        standby, position, ramp = self._at(elapsed, memory.start)
        zeros = np.zeros(len(self.joints))
        command = MITCommand(position, zeros, zeros, self.target_stiffness * ramp, self.target_damping * ramp)
        return StandbyMemory(standby=standby, start=memory.start, elapsed=elapsed, time=time), command

    def _problem(self, state: MITState) -> str:
        known = np.isfinite(state.joint_position)
        if known.all():
            return time_problem(state)
        i = int(np.argmin(known))
        return f"position of {self.joints[i]} is {state.joint_position[i]}, expected a finite number"

    def _at(self, elapsed: float, start: FloatArray) -> tuple[StandbyState, FloatArray, float]:
        """Return progress, position (n,) and gain ramp [0, 1] after `elapsed` s of trajectory."""
        total = len(self.segment_durations)
        begin, previous = 0.0, start
        for i, duration in enumerate(self.segment_durations.tolist()):
            if elapsed < begin + duration:
                progress = min((elapsed - begin) / duration, 1.0)  # rounding may put it just above
                position = previous + (self.pose_segments[i] - previous) * progress
                return StandbyState(i, total, progress, False), position, progress if i == 0 else 1.0
            begin, previous = begin + duration, self.pose_segments[i]
        return StandbyState(total - 1, total, 1.0, True), previous, 1.0
