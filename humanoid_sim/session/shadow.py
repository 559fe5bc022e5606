"""A policy that runs on the state of a robot which somebody else drives; nothing of it reaches a motor.

It works on copies of the ticks, on a thread of its own: a policy that fails, answers nonsense or takes its time changes
no tick. Only a sink hears of it; the control stack does not know it.
"""

from __future__ import annotations

from collections.abc import Callable
from time import sleep
from typing import Any

import numpy as np

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.rl_policy import RLPolicyController, RLPolicyMemory
from humanoid_sim.messages import Event, Mode, SessionHeader, TickRecord
from humanoid_sim.mit import FloatArray, MITCommand, mit_torque
from humanoid_sim.recording.shadow import ShadowStep
from humanoid_sim.session.sinks import WorkerSink

WATCHED_MODES = frozenset((Mode.DAMPING, Mode.STANDBY))
"""In which a shadow policy runs."""
_LATEST = 1.0
"""s that a tick may wait where the run keeps real time: what a policy says later is of no use to anybody who looks."""
_QUIET = 1.0
"""s on the robot's clock between two reports of what goes wrong."""
_LONGEST = 200
"""Characters of a fault's text."""


class ShadowSink(WorkerSink):
    """Runs a policy on the ticks in DAMPING and STANDBY.

    It begins afresh when the controller changes, when STANDBY has reached its pose, as LOCOMOTION would there, and one
    period of the policy's after a fault.
    """

    def __init__(
        self,
        controller: RLPolicyController,
        source: str,
        effort_limit: FloatArray,
        *,
        realtime: bool,
        publish: Callable[[ShadowStep], None],
        tell: Callable[[Event], None],
    ) -> None:
        """Start empty.

        Args:
            controller: of the policy. It is the sink's alone.
            effort_limit: shape (n,), N·m, of the joints.
            realtime: whether the run keeps real time, and so does not wait for a policy that is slow.
            publish: takes each step, on this sink's thread.
            tell: is told what an operator should know, on this sink's thread.
        """
        super().__init__("shadow", period=min(0.02, controller.contract.policy_dt))
        self._controller = controller
        self._source = source
        self._effort_limit = effort_limit
        self._limit = max(round(_LATEST / controller.control_period), 2) if realtime else None
        self._publish, self._tell = publish, tell
        self._memory: RLPolicyMemory | None = None
        self._phase: tuple[str, bool] | None = None
        self._wait = 0
        self._index = -1
        self._told: float | None = None
        self._newest = 0
        self.steps = 0
        """Inferences that came to a command."""
        self.faults = 0
        self.first_fault: tuple[float, str] | None = None
        """s on the robot's clock, and what it was."""
        self.saturated = 0
        """Commands that would have asked a joint for its effort limit."""
        self.largest_offset = 0.0
        """rad, between what it would have commanded and where the joint was."""
        self.largest_joint = ""

    def tick(self, record: TickRecord) -> None:
        """Queue a tick. Never waits; where the run keeps real time, a tick that would wait too long is left out."""
        self._newest = record.index
        if self._limit is not None and len(self._queue) >= self._limit:
            self.lost += 1
        else:
            super().tick(record)

    def event(self, event: Event) -> None:
        """Nothing: a policy observes ticks."""

    def handle_start(self, header: SessionHeader) -> None:
        """Say what runs."""
        self._tell(Event(0.0, f"shadow policy {self._source}: nothing of it reaches a motor"))

    def handle_tick(self, record: TickRecord) -> None:
        """One tick of the policy, if the robot is in a mode for it."""
        missing, self._index = record.index - self._index - 1, record.index
        output = record.output
        mode = output.control_mode
        if mode.mode not in WATCHED_MODES:
            self._phase = self._memory = None
            return
        phase = mode.controller_name, output.standby is not None and output.standby.is_finished
        if phase != self._phase or missing:
            self._memory, self._wait = None, 0
        self._phase = phase
        if missing:
            self._report(float(record.input.state.time), f"{missing} ticks left out: it is too slow")
        if self._wait:
            self._wait -= 1
            return
        self._step(record)

    def _step(self, record: TickRecord) -> None:
        memory = self._controller.activate(record.input) if self._memory is None else self._memory
        result = memory if isinstance(memory, Fault) else self._controller.update(memory, record.input)
        time = float(record.input.state.time)
        if isinstance(result, Fault):
            self._memory, self._wait = None, self._controller.decimation - 1
            self.faults += 1
            text = result.message[:_LONGEST]
            self.first_fault = self.first_fault or (time, text)
            self._report(time, f"failed: {text}")
            self._publish(ShadowStep(record.index, time, result.policy_step, fault=text))
            return
        self._memory, command = result
        if self._memory.policy_step is not None:
            self.steps += 1
            self._measure(record, command)
            self._publish(ShadowStep(record.index, time, self._memory.policy_step, command))
            sleep(0)  # lets the control thread in before the next

    def _measure(self, record: TickRecord, command: MITCommand) -> None:
        state = record.input.state
        effort = mit_torque(command, state.joint_position, state.joint_velocity, self._effort_limit)
        self.saturated += bool((np.abs(effort) >= self._effort_limit * (1.0 - 1e-9)).any())
        offset = np.abs(command.position - state.joint_position)
        largest = int(offset.argmax())
        if offset[largest] > self.largest_offset:
            self.largest_offset, self.largest_joint = float(offset[largest]), self._controller.joints[largest]

    def _report(self, time: float, text: str) -> None:
        """Tell what goes wrong, once a second at most: it may go wrong in every step."""
        if self._told is None or not abs(time - self._told) < _QUIET:
            self._told = time
            self._tell(Event(time, f"shadow policy: {text}"))

    def figures(self) -> dict[str, Any]:
        """Return what became of it so far: for the feed's status and the final table; JSON."""
        first = self.first_fault
        return {
            "policy": self._source,
            "steps": self.steps,
            "faults": self.faults,
            "first_fault": None if first is None else {"time": first[0], "message": first[1]},
            "left_out": self.lost,
            "behind": (self._newest - self._index) * self._controller.control_period,
            "saturated": self.saturated,
            "largest_offset": self.largest_offset,
            "largest_joint": self.largest_joint,
        }
