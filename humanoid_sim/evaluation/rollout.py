"""The closed loop of a policy and simulated robots, one or a batch: observe, act, and where that leads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.guards import GuardMemory, Guards
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.evaluation.step import StepSample
from humanoid_sim.mit import (
    VELOCITY_COMMAND,
    BoolArray,
    Extern,
    Float32Array,
    FloatArray,
    IndexArray,
    MITCommand,
    MITState,
)
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.sim_robot import SimRobot

Robots: TypeAlias = SimRobot | BatchSim
"""One robot, arrays of shape (…), or N of them, (N, …), whose control period is one policy step."""


class ClosedLoop:
    """A policy's wiring around robots that advance by one policy step at a time. Not thread-safe."""

    def __init__(
        self, robots: Robots, wiring: PolicyWiring, velocity: FloatArray, guards: Guards | None = None
    ) -> None:
        """Begin where the robots now are, at the start of an episode.

        `velocity` has the commands, shape (..., 3): vx and vy in m/s and yaw rate in rad/s, heading frame.
        """
        self.robots, self.wiring, self.guards = robots, wiring, guards
        self.velocity = self.command = velocity
        """Shape (..., 3): the commands that are observed, and those in the latest step."""
        self.state = self._read()
        """State that is observed, with the velocity command where the policy depends on one."""
        self.observation, self.memory = wiring.observe(wiring.activate(self.state), self.state)
        self.previous = self.memory.last_action
        """Shape (..., m), raw: the action before the latest one; zeros before the first."""
        self.alarms: Mapping[int, str] = {}
        """Guards that tripped in the latest step, in words, by robot, 0 for the only one: these did not move in it."""
        self._watched: GuardMemory | None = None

    def restart(self, chosen: IndexArray, velocity: FloatArray) -> None:
        """Restart the robots of a batch with indices `chosen`, (k,), which are at the start of an episode.

        `velocity`, (N, 3), has the commands of all.
        """
        self.velocity = velocity
        self.state = self._read()
        rows = state_rows(self.state, chosen)
        observation, memory = self.wiring.observe(self.wiring.activate(rows), rows)
        if self._watched is not None:  # no condition of theirs holds yet
            self._watched = replace(self._watched, held=_with_rows(self._watched.held, chosen, -1.0))
        self.command = _with_rows(self.command, chosen, velocity[chosen])
        self.observation = _with_rows(self.observation, chosen, observation)
        self.memory = _with_rows(self.memory, chosen, memory)
        self.previous = _with_rows(self.previous, chosen, memory.last_action)

    def act(
        self, action: Float32Array, *, velocity: FloatArray | None = None, where: BoolArray | None = None
    ) -> MITCommand:
        """One policy step, and the observation after it. Returns the command, shape (..., n).

        The action is raw, shape (..., m); `velocity`, shape (..., 3), has the commands from then on, None: as before.
        `where` is as of `BatchSim.step`, for a batch only.
        """
        self.previous, self.command, self.alarms = self.memory.last_action, self.velocity, {}
        memory, command = self.wiring.act(self.memory, action)
        if self.guards is not None:
            self._watched = self.guards.watch(self._watched, self.state, command)
            self.alarms = self.guards.problems(self._watched, self.state, command)
        if isinstance(self.robots, BatchSim):
            if self.alarms:
                where = np.ones(len(action), dtype=np.bool_) if where is None else where.copy()
                where[list(self.alarms)] = False
            self.robots.step(command, where=where)
        elif self.alarms:
            return command
        else:
            self.robots.write(command)
        self.velocity = self.velocity if velocity is None else velocity
        self.state = self._read()
        self.observation, self.memory = self.wiring.observe(memory, self.state)
        return command

    def sample(self, step: int | npt.NDArray[np.integer]) -> StepSample:
        """Return the latest step. `step`, shape (...), counts the policy steps since the start."""
        position, quaternion = self.robots.body_poses(in_base=True)
        return StepSample(
            state=self.robots.state(),
            frame=self.memory.frame,
            action=self.memory.last_action,
            previous_action=self.previous,
            torque=self.robots.effort,
            step=step,
            body_position=position,
            body_quaternion=quaternion,
            command=self.command,
            base=self.robots.base,
            alignment=self.memory.alignment,
        )

    def _read(self) -> MITState:
        state = self.robots.state()
        if self.wiring.takes_velocity_command:
            state = replace(state, extern={**state.extern, VELOCITY_COMMAND: Extern(self.velocity, 0.0)})
        return state


def state_rows(state: MITState, indices: IndexArray | int) -> MITState:
    """Return the reports of k of the N robots, or of one."""
    arrays = {f.name: getattr(state, f.name)[indices] for f in fields(state) if f.name != "extern"}
    live = {name: replace(value, value=value.value[indices]) for name, value in state.extern.items()}
    return MITState(**arrays, extern=live)


def _with_rows(whole: Any, indices: IndexArray, rows: Any) -> Any:
    """Return an array of shape (N, …), or a dataclass of such, with k robots' rows, shape (k, …), replaced."""
    if whole is None:
        return None
    if is_dataclass(whole) and not isinstance(whole, type):
        names = [each.name for each in fields(whole)]
        parts = {name: _with_rows(getattr(whole, name), indices, getattr(rows, name)) for name in names}
        return replace(whole, **parts)
    changed = np.array(whole)
    changed[indices] = rows
    return changed
