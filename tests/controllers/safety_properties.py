"""The safety properties of the control stack, checked on each tick from inputs and outputs alone.

Everything here is written out again, from the operator's point of view: no rule, table or helper of the package.
"""

from __future__ import annotations

import math

import numpy as np
from rig import DAMPING_KD, JOINTS, PASSIVE_KD, POLICY_KD, POLICY_KP, fingerprint

from humanoid_sim.messages import Intent, RemoteCommand, TickInput, TickOutput
from humanoid_sim.mit import MITCommand

ZERO = "zero_torque_controller"
DAMPING = "damping_controller"
STANDBY_A = "standby_controller_a"
STANDBY_B = "standby_controller_b"
RL = "rl_policy_controller"
REMOTE = "remote_policy_controller"

MODE_NUMBER = {ZERO: 0, DAMPING: 1, STANDBY_A: 2, STANDBY_B: 2, RL: 3, REMOTE: 4}
SAFE = (ZERO, DAMPING)

EDGES = {
    (ZERO, DAMPING): {Intent.DAMP},
    (DAMPING, STANDBY_A): {Intent.LOAD_A},
    (DAMPING, STANDBY_B): {Intent.LOAD_B},
    (STANDBY_A, RL): {Intent.START_LOCOMOTION},
    (STANDBY_A, REMOTE): {Intent.START_REMOTE},
    (STANDBY_B, RL): {Intent.START_LOCOMOTION},
    (STANDBY_B, REMOTE): {Intent.START_REMOTE},
}
"""Between two ticks the controller stays, follows one of these edges with its intent, or leaves for SAFE."""

TIMEOUT = 0.1
"""s, `stale_command_timeout_ms` of the rig."""


class SafetyProperties:
    """Watches one run from its first tick."""

    def __init__(self) -> None:
        self.name = ZERO
        self.finished = False
        self.time = math.nan
        self.activation_time = math.nan
        self.ignored: RemoteCommand | None = None
        self.newest: RemoteCommand | None = None
        self.age = math.inf

    def check(self, given: TickInput, output: TickOutput) -> None:
        """Assert every property for this tick."""
        name = output.control_mode.controller_name
        self._command_is_complete(output.command)
        self._mode_follows(name, given, output)
        self._faults_are_contained(name, output)
        self._follow_remote(name, given)
        self._command_is_the_controllers(name, given, output.command)
        self.name, self.finished = name, output.standby is not None and output.standby.is_finished
        self.time = float(given.state.time)

    def _command_is_complete(self, command: MITCommand) -> None:
        for values in (command.position, command.velocity, command.effort, command.stiffness, command.damping):
            assert values.shape == (len(JOINTS),)
            assert values.dtype == np.float64
            assert not values.flags.writeable
            assert np.isfinite(values).all()
        assert (command.stiffness >= 0).all()
        assert (command.damping >= 0).all()

    def _mode_follows(self, name: str, given: TickInput, output: TickOutput) -> None:
        wanted = set(given.intents)
        unsafe = any(status.level.value > 0 for status in given.safety)
        assert output.control_mode.mode.value == MODE_NUMBER[name]
        assert (output.standby is not None) == (output.control_mode.mode.value == 2)
        if Intent.DAMP in wanted:
            assert name == DAMPING or (name == ZERO and "takes over" in output.control_mode.status_message)
        if unsafe:
            assert name in SAFE
        if self.name in SAFE and not wanted:
            assert name == self.name
        if name != self.name:
            assert name in SAFE or (self.name, name) in EDGES
            if name not in SAFE:
                assert EDGES[self.name, name] <= wanted
            if name in (RL, REMOTE):
                assert self.finished
            if self.name == ZERO:
                assert name == DAMPING
                assert Intent.DAMP in wanted
            assert self.name != DAMPING or name != ZERO, "DAMPING was active and went limp"
        if output.quit:
            assert Intent.QUIT in wanted
            assert Intent.DAMP not in wanted
            assert self.name in SAFE
        elif Intent.QUIT in wanted:
            assert any(text.startswith("QUIT refused: ") for text in output.refusals)

    def _faults_are_contained(self, name: str, output: TickOutput) -> None:
        failed = [fault.controller for fault in output.faults]
        assert name not in failed
        assert ZERO not in failed
        assert len(set(failed)) == len(failed)
        assert [fault.fallback for fault in output.faults] == [*failed[1:], name][: len(failed)]
        for fault in output.faults:
            assert fault.message
            assert not fault.is_bug
            assert fault.message in output.control_mode.status_message

    def _follow_remote(self, name: str, given: TickInput) -> None:
        """Keep the age of the newest command in time that passed since it was first shown to the controller."""
        time = float(given.state.time)
        if name != REMOTE:
            self.newest, self.age = None, math.inf
            return
        if self.name != REMOTE:
            self.newest, self.age = None, math.inf
            self.activation_time, self.ignored = time, given.remote
            return
        self.age += max(time - self.time, 0.0)
        remote = given.remote
        if remote is None or (self.ignored is not None and remote.arrival_time == self.ignored.arrival_time):
            return
        if not remote.arrival_time > self.activation_time:
            return
        if self.newest is None or remote.arrival_time != self.newest.arrival_time:
            self.age = 0.0
        self.newest = remote

    def _command_is_the_controllers(self, name: str, given: TickInput, command: MITCommand) -> None:
        """The gains of the rig tell its controllers apart."""
        kp, kd = command.stiffness, command.damping
        if name == ZERO:
            assert fingerprint(command) == fingerprint(MITCommand.zeros(len(JOINTS)))
        elif name == REMOTE:
            self._remote_command_counts(given, command)
        else:
            assert not command.velocity.any()
            assert not command.effort.any()
            if name == DAMPING:
                assert kp.tolist() == [0.0, 0.0, 0.0]
                assert kd.tolist() == DAMPING_KD
            elif name == RL:
                assert kp.tolist() == POLICY_KP
                assert kd.tolist() == POLICY_KD
                assert command.position[2] == 0.0
            else:
                stiffness = np.array([10.0, 11.0, 12.0] if name == STANDBY_A else [20.0, 21.0, 22.0])
                ramp = kp / stiffness
                assert 0.0 <= ramp[0] <= 1.0
                assert ramp[0] == 0.0 or name == self.name, "the gains did not start from 0"
                np.testing.assert_allclose(ramp, ramp[0], rtol=1e-12)
                np.testing.assert_allclose(kd, 0.1 * kp, rtol=1e-12)

    def _remote_command_counts(self, given: TickInput, command: MITCommand) -> None:
        position = given.state.joint_position
        passive = MITCommand(
            np.where(np.isfinite(position), position, 0.0), np.zeros(3), np.zeros(3), np.zeros(3), np.array(PASSIVE_KD)
        )
        if fingerprint(command) == fingerprint(passive):
            return
        assert self.newest is not None, "a command from before activation was applied"
        assert fingerprint(command) == fingerprint(self.newest.command)
        assert self.age <= TIMEOUT + 1e-9, "a stale command was applied"
