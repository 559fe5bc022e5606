"""The safety properties of a control stack, checked on each tick from inputs and outputs alone.

Everything here is written out again, from the operator's point of view: no rule or table of the FSM is used, so a
mistake there cannot hide itself. What a mode's command must look like is taken from the settings of its controller.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Self

from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, TickInput, TickOutput
from humanoid_sim.mit import MITCommand
from humanoid_sim.testing.checks import (
    GuardWatch,
    RemoteWatch,
    check_complete,
    check_damping,
    check_policy,
    check_standby,
    check_zero,
    require,
)

ZERO = "zero_torque_controller"
DAMPING = "damping_controller"
STANDBY_A = "standby_controller_a"
STANDBY_B = "standby_controller_b"
RL = "rl_policy_controller"
REMOTE = "remote_policy_controller"

MODE_NUMBER: Mapping[str, int] = {ZERO: 0, DAMPING: 1, STANDBY_A: 2, STANDBY_B: 2, RL: 3, REMOTE: 4}
"""The mode that each controller is, as on the wire."""

SAFE = (ZERO, DAMPING)

EDGES: Mapping[tuple[str, str], Intent] = {
    (ZERO, DAMPING): Intent.DAMP,
    (DAMPING, STANDBY_A): Intent.LOAD_A,
    (DAMPING, STANDBY_B): Intent.LOAD_B,
    (STANDBY_A, RL): Intent.START_LOCOMOTION,
    (STANDBY_A, REMOTE): Intent.START_REMOTE,
    (STANDBY_B, RL): Intent.START_LOCOMOTION,
    (STANDBY_B, REMOTE): Intent.START_REMOTE,
}
"""Between two ticks the controller stays, follows one of these edges with its intent, or leaves for SAFE."""


class SafetyProperties:
    """Watches one run of a stack from its first tick.

    - The command is finite, complete, read-only and as its mode's controller must give it.
    - DAMP is obeyed in the tick in which it arrives, from every mode.
    - No tick with a safety status other than OK ends in a mode that moves.
    - A mode changes only by the operator's intent along the FSM's edges, or down to DAMPING or ZERO_TORQUE; nothing
      recovers by itself, and DAMPING never goes limp.
    - A controller that fails is named with its fallback, which gives this tick's command; none raises.
    - A joint that is pressed, pushed out of its limits, or raced, for longer than the stack's guards allow ends the
      mode; so a guard's trip ends in DAMPING in its tick.
    - LOCOMOTION and REMOTE begin only after a standby pose was reached.
    - A remote command from before the activation, or one that is stale, is never applied.
    """

    def __init__(self, stack: Supervisor) -> None:
        self._stack = stack
        self._name = ZERO
        self._finished = False
        self._time = math.nan
        self._command: MITCommand | None = None
        self._remote = RemoteWatch(stack.controllers.get(REMOTE))
        self._guards = GuardWatch(getattr(stack, "guards", None))

    def copy(self) -> Self:
        """Another watch over the same run, at the same tick."""
        other = copy.copy(self)
        other._remote = copy.copy(self._remote)
        other._guards = self._guards.copy()
        return other

    def check(self, given: TickInput, output: TickOutput) -> None:
        """Check every property for this tick, which follows the one checked before."""
        name = output.control_mode.controller_name
        check_complete(output.command, len(self._stack.joints))
        self._check_mode(name, given, output)
        self._check_change(name, given, output)
        self._check_quit(given, output)
        self._check_faults(name, output)
        self._check_command(name, given, output.command)
        elapsed = float(given.state.time) - self._time
        self._guards.check(given, output.command, moves=name not in SAFE, elapsed=elapsed)
        self._name, self._finished = name, output.standby is not None and output.standby.is_finished
        self._time, self._command = float(given.state.time), output.command

    def _check_mode(self, name: str, given: TickInput, output: TickOutput) -> None:
        mode = output.control_mode.mode
        require(name in MODE_NUMBER, "controller {} is none of {}", name, ", ".join(MODE_NUMBER))
        require(mode.value == MODE_NUMBER[name], "{} reports mode {}", name, mode.name)
        require((output.standby is not None) == (mode.value == 2), "{} with standby {}", mode.name, output.standby)
        unsafe = [status for status in given.safety if status.level.value > 0]
        require(not unsafe or name in SAFE, "{} is in control although safety reports {}", name, unsafe)
        if Intent.DAMP in given.intents:
            failed = name == ZERO and any(fault.controller == DAMPING for fault in output.faults)
            require(name == DAMPING or failed, "DAMP was requested, and {} is in control", name)

    def _check_change(self, name: str, given: TickInput, output: TickOutput) -> None:
        before, wanted = self._name, given.intents
        if name == before:
            return
        require(before not in SAFE or bool(wanted), "{} went to {} by itself", before, name)
        if name not in SAFE or before == ZERO:
            edge = EDGES.get((before, name))
            require(edge is not None, "{} went to {}, which is not an edge of the FSM", before, name)
            require(edge in wanted, "{} went to {} without {}; intents: {}", before, name, edge, wanted)
        if name in (RL, REMOTE):
            require(self._finished, "{} began before {} had finished", name, before)
        require((before, name) != (DAMPING, ZERO), "DAMPING was active and went limp: {}", output.control_mode)

    def _check_quit(self, given: TickInput, output: TickOutput) -> None:
        if output.quit:
            require(Intent.QUIT in given.intents, "quit without QUIT; intents: {}", given.intents)
            require(Intent.DAMP not in given.intents, "QUIT was obeyed although DAMP came with it")
            require(self._name in SAFE, "QUIT was obeyed from {}", self._name)
        elif Intent.QUIT in given.intents:
            said = any(text.startswith("QUIT refused: ") for text in output.refusals)
            require(said, "QUIT had no effect and no refusal says why: {}", output.refusals)

    def _check_faults(self, name: str, output: TickOutput) -> None:
        failed = [fault.controller for fault in output.faults]
        require(name not in failed, "{} failed and stays in control", name)
        require(ZERO not in failed, "{} failed", ZERO)
        require(len(set(failed)) == len(failed), "a controller failed twice in one tick: {}", failed)
        chain = [fault.fallback for fault in output.faults]
        require(chain == [*failed[1:], name][: len(failed)], "{} failed, fallbacks {}, {} leads", failed, chain, name)
        status = output.control_mode.status_message
        for fault in output.faults:
            require(not fault.is_bug, "{} raised: {}", fault.controller, fault.message)
            require(bool(fault.message), "{} failed without saying why", fault.controller)
            require(fault.message in status, "'{}' is not in the status message '{}'", fault.message, status)

    def _check_command(self, name: str, given: TickInput, command: MITCommand) -> None:
        controller = self._stack.controllers[name]
        before = self._command if name == self._name else None
        if name != REMOTE:
            self._remote.leave()
        if name == ZERO:
            check_zero(command)
        elif name == DAMPING:
            check_damping(controller, command, before)
        elif name in (STANDBY_A, STANDBY_B):
            check_standby(controller, command, before)
        elif name == RL:
            check_policy(controller, self._stack.joints, command)
        else:
            time = float(given.state.time)
            self._remote.follow(given, entered=self._name != REMOTE, elapsed=time - self._time)
            self._remote.check(given, command)
