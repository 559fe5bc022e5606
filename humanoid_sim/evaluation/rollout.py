"""The closed loop of a policy and simulated robots, one or a batch: what it sees and does, and where that leads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Protocol, Self, TypeVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.guards import GuardMemory, Guards
from humanoid_sim.controllers.live_inputs import LiveInputs
from humanoid_sim.controllers.policy_step import PolicyMemory, PolicyWiring, shown_phase
from humanoid_sim.controllers.reference import Alignment, Frame
from humanoid_sim.messages import SafetyStatus
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.simulation.floating_base import BaseState
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]
IndexArray = npt.NDArray[np.intp]
Scalar = TypeVar("Scalar", bound=np.generic)


class Robots(Protocol):
    """Simulated robots of shape (...): `BatchSimulation`, or `OneRobot`."""

    def step(self, command: MITCommand, *, wrench: FloatArray | None = None, where: BoolArray | None = None) -> None:
        """Advance by one policy step, as `BatchSimulation.step` does."""

    def state(self) -> MITState:
        """Return what the robots report now."""
        ...


class TransparentRobots(Robots, Protocol):
    """Robots that also tell what truly is, whatever delays and noise do to `state`."""

    @property
    def effort(self) -> FloatArray:
        """Shape (..., n), N·m, saturated, of the latest physics step."""

    @property
    def base(self) -> BaseState | None:
        """Return the base's state, of robots with a floating base."""

    def truth(self) -> MITState:
        """Return the true state now."""
        ...

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """Positions (..., b, 3), m, and quaternions (..., b, 4) of the bodies that are tracked."""
        ...


@dataclass(slots=True, eq=False)
class OneRobot:
    """A simulated robot whose control period is one policy step, shape ()."""

    robot: MujocoRobot
    safety: SafetyStatus = field(default_factory=SafetyStatus)
    """Status of the latest state."""

    def step(self, command: MITCommand, *, wrench: FloatArray | None = None, where: BoolArray | None = None) -> None:
        """See `Robots.step`; nothing pushes it, and it does not stand still."""
        self.robot.write(command)

    def state(self) -> MITState:
        """See `Robots.state`."""
        state, (self.safety,) = self.robot.read()
        return state


class ClosedLoop:
    """A policy's wiring around robots that advance by one policy step at a time. Not thread-safe.

    In turn: the policy, on `observation` and `memory.frame`; `act`.
    """

    def __init__(
        self,
        robots: Robots,
        wiring: PolicyWiring,
        velocity: FloatArray,
        live: LiveInputs | None = None,
        guards: Guards | None = None,
        frame: Frame | None = None,
    ) -> None:
        """Begin where the robots now are.

        Args:
            robots: shape (...), at the start of an episode.
            wiring: of the policy on one of them.
            velocity: shape (..., 3), vx and vy in m/s and yaw rate in rad/s, heading frame: the commands.
            live: feeds the live inputs that the contract declares; None: nothing does.
            guards: that watch the joints, as in the control stack; None: nothing does.
            frame: shape (...), of the reference, to begin with; None: 0.
        """
        self.robots = robots
        self.wiring = wiring
        self.live = LiveInputs(wiring.contract) if live is None else live
        self.velocity = velocity
        """Shape (..., 3): the commands that are observed."""
        self.state = self._reported()
        """State that is observed; with the velocity command, where the policy depends on one."""
        self.observation, self.memory = wiring.observe(wiring.activate(self.state, frame), self.state)
        self.action = self.previous = self.memory.last_action
        """Shape (..., m), raw: of the latest step, and of the one before; zeros before the first."""
        self.asked = velocity
        """Shape (..., 3): the commands in the latest step."""
        self.guards = guards
        self.tripped: BoolArray = np.zeros((), dtype=np.bool_)
        """Shape (...), or () for none: robots for which a guard tripped in the latest step. They did not move in it."""
        self._watched: GuardMemory | None = None
        self._alarms: Mapping[int, str] = {}

    def snapshot(self) -> dict[str, Any]:
        """All that it keeps beside robots and wiring, for `resumed`; shares its arrays."""
        return {name: value for name, value in vars(self).items() if name not in ("robots", "wiring", "live")}

    @classmethod
    def resumed(
        cls, robots: Robots, wiring: PolicyWiring, snapshot: Mapping[str, Any], live: LiveInputs | None = None
    ) -> Self:
        """Return the loop of that snapshot, around robots that are in the state in which it was taken."""
        loop = cls.__new__(cls)
        live = LiveInputs(wiring.contract) if live is None else live
        vars(loop).update(snapshot, robots=robots, wiring=wiring, live=live)
        return loop

    def restart(self, chosen: IndexArray, velocity: FloatArray, frame: Frame | None = None) -> None:
        """Restart the robots of a batch with indices `chosen`, (k,), which are at the start of an episode.

        `velocity`, (N, 3), has the commands of all, `frame`, (k,), the reference's frames to begin with; None: 0.
        """
        self.velocity = velocity
        self.asked = _with(self.asked, chosen, velocity[chosen])
        self.state = self._reported()
        rows = _state_rows(self.state, chosen)
        observation, memory = self.wiring.observe(self.wiring.activate(rows, frame), rows)
        if self.guards is not None:
            self._watched = self.guards.restarted(self._watched, chosen)
        self.observation = _with(self.observation, chosen, observation)
        self.memory = _memory_with(self.memory, chosen, memory)
        self.action, self.previous = (
            _with(of_step, chosen, memory.last_action) for of_step in (self.action, self.previous)
        )

    def infer(self, policy: Callable[[Float32Array, Any], Float32Array]) -> tuple[Float32Array, BoolArray]:
        """Return the policy's raw actions, shape (..., m), and which a controller would accept, shape (...)."""
        action = policy(self.observation, self.memory.frame)
        return action, self.wiring.accepts(action) & np.isfinite(self.observation).all(axis=-1)

    def problem(self, action: Float32Array, i: int) -> str:
        """Return why a controller would not accept what robot `i` of a batch observes, or its action, shape (m,)."""
        return self.wiring.observation_problem(self.observation[i]) or self.wiring.action_problem(action[i])

    def alarm(self, i: int = 0) -> str:
        """Return what the guard saw that tripped for robot `i` in the latest step; 0 for the only one."""
        return self._alarms.get(i, "")

    def act(
        self,
        action: Float32Array,
        *,
        velocity: FloatArray | None = None,
        wrench: FloatArray | None = None,
        where: BoolArray | None = None,
    ) -> MITCommand:
        """One policy step, and the observation after it.

        The action is raw, shape (..., m); `velocity`, shape (..., 3), has the commands from then on, None: as before.
        `wrench` and `where` are as of `BatchSimulation.step`. Returns the command, shape (..., n).
        """
        self.previous, self.asked, self.action = self.memory.last_action, self.velocity, action
        memory, command = self.wiring.act(self.memory, action)
        if self.guards is not None:
            self._watched = self.guards.watch(self._watched, self.state, command)
            self.tripped = self.guards.tripped(self._watched)
            self._alarms = {}
            if self.tripped.any():
                self._alarms = self.guards.problems(self._watched, self.state, command)
                if self.tripped.all():
                    return command
                where = ~self.tripped if where is None else where & ~self.tripped
        self.robots.step(command, wrench=wrench, where=where)
        self.velocity = self.velocity if velocity is None else velocity
        self.state = self._reported()
        self.observation, self.memory = self.wiring.observe(memory, self.state)
        return command

    def _reported(self) -> MITState:
        state = self.robots.state()
        if self.wiring.takes_velocity_command:
            state = replace(state, extern={**state.extern, VELOCITY_COMMAND: Extern(self.velocity, 0.0)})
        return self.live.extend(state)


@dataclass(frozen=True, slots=True, eq=False)
class StepSample:
    """One policy step: an action, and where it has brought the robot one `policy_dt` later."""

    state: MITState
    """At the end of the step, as it is: whatever delays or noise the policy sees it through."""
    action: Float32Array
    """Shape (..., m), raw: the one that was in force during the step."""
    previous_action: Float32Array
    """Shape (..., m), raw: the one before; zeros in the first step."""
    torque: FloatArray
    """Shape (..., n), N·m, saturated, of the step's last physics step."""
    frame: Frame
    """Shape (...), the reference frame that belongs to `state`: the next one to be shown, frame 1 after the first step
    and the last one again from the end of the motion on."""
    step: int | npt.NDArray[np.integer]
    """Shape (...), policy steps since the start, this one included: at least 1."""
    body_position: FloatArray
    """Shape (..., b, 3), m, base frame, of the contract's `body_names` at `state`; b is 0 where it names none."""
    body_quaternion: FloatArray
    """Shape (..., b, 4), w x y z, body frame in the base frame; of either sign."""
    command: FloatArray
    """Shape (..., 3), vx and vy in m/s and yaw rate in rad/s, heading frame: what was asked for during the step."""
    base: BaseState | None = None
    """State of a floating base, at `state`; None for robots with a fixed one."""
    alignment: Alignment | None = None
    """Alignment of the reference with the robot at the start."""
    phase: FloatArray | None = None
    """Shape (..., k), rad: the gait phase that is observed at `state`; NaN while the robot stands. None without one."""


def sample_step(loop: ClosedLoop, robots: TransparentRobots, step: int | npt.NDArray[np.integer]) -> StepSample:
    """Return the latest step as it truly was, whatever the sensors make of it.

    `step`, shape (...), counts the policy steps since the start, this one included.
    """
    position, quaternion = robots.body_poses(in_base=True)
    contract = loop.wiring.contract
    phase = None
    if contract.phase is not None:
        phase = shown_phase(contract.phase, loop.memory.walked, loop.velocity, contract.policy_dt)
    return StepSample(
        state=robots.truth(),
        action=loop.action,
        previous_action=loop.previous,
        torque=robots.effort,
        frame=loop.memory.frame,
        step=step,
        body_position=position,
        body_quaternion=quaternion,
        command=loop.asked,
        base=robots.base,
        alignment=loop.memory.alignment,
        phase=phase,
    )


def _state_rows(state: MITState, indices: IndexArray) -> MITState:
    """Return the reports of k of the N robots."""
    arrays = {f.name: getattr(state, f.name)[indices] for f in fields(state) if f.name != "extern"}
    live = {name: replace(value, value=value.value[indices]) for name, value in state.extern.items()}
    return MITState(**arrays, extern=live)


def _memory_with(memory: PolicyMemory, indices: IndexArray, rows: PolicyMemory) -> PolicyMemory:
    """Return a memory of shape (N, …) with k robots' rows, shape (k, …), replaced."""
    alignment = memory.alignment
    if alignment is not None and rows.alignment is not None:
        alignment = Alignment(
            _with(alignment.yaw, indices, rows.alignment.yaw), _with(alignment.offset, indices, rows.alignment.offset)
        )
    history = memory.history
    if history is not None and rows.history is not None:
        history = _with(history, indices, rows.history)
    return PolicyMemory(
        frame=_with(np.asarray(memory.frame), indices, rows.frame),
        last_action=_with(memory.last_action, indices, rows.last_action),
        history=history,
        walked=_with(np.asarray(memory.walked), indices, rows.walked),
        alignment=alignment,
    )


def _with(array: npt.NDArray[Scalar], indices: IndexArray, rows: npt.ArrayLike) -> npt.NDArray[Scalar]:
    changed = array.copy()
    changed[indices] = rows
    return changed
