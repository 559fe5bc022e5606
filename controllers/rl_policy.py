"""LOCOMOTION: run a learned policy at its own rate and hold its command in between."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.action import ActionMap, action_command, resolve_action
from humanoid_sim.controllers.base import DAMPING, Fault, Memory
from humanoid_sim.controllers.context import ANCHOR_POSE
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationContext, ObservationLayout, pack, resolve_observation, stack
from humanoid_sim.controllers.parameters import joint_tuple, number
from humanoid_sim.controllers.phase import advance_phase
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.controllers.sources import live_command
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import PolicyStep, TickInput
from humanoid_sim.mit import FloatArray, MITCommand, MITState

__all__ = ["ACTION_LIMIT", "Policy", "RLPolicyController", "RLPolicyMemory"]

Float32Array = npt.NDArray[np.float32]

Policy = Callable[[Float32Array, int], npt.ArrayLike]
"""`(observation of shape (N,), reference frame) -> raw action of shape (m,)`. Same input, same output."""

ACTION_LIMIT = 100.0
"""Largest magnitude of a raw action unless another is given: trained policies stay within a few units, and beyond this
one has diverged."""

_RATE_TOLERANCE = 1e-6
"""Relative. Periods are decimal fractions that binary numbers round; a real mismatch is far larger."""


@dataclass(frozen=True, slots=True, eq=False)
class RLPolicyMemory(Memory):
    """Where in the motion and between two inferences the policy is."""

    frame: int = 0
    """The reference frame that the next inference shows."""
    held_ticks: int = 0
    """Ticks since the last inference; at `decimation` the next one is due."""
    last_action: Float32Array = field(default_factory=lambda: np.empty(0, dtype=np.float32))
    """Shape (m,), raw; zeros at activation."""
    command: MITCommand | None = None
    history: Float32Array | None = None
    """Shape (h, step_width), what was observed in the last steps, oldest first; None before the first, or without."""
    walked: float = 0.0
    """rad of gait phase since activation, or since standing."""
    alignment: Alignment | None = None
    """How the reference was laid onto the robot."""


@dataclass(frozen=True, slots=True, eq=False)
class RLPolicyController:
    """Observation → policy → action → command, once every `policy_dt`.

    A non-finite observation or action, a wrong size, an action beyond its limit, or a policy that raises is a fault,
    never a command.
    """

    fallback: ClassVar[str | None] = DAMPING

    joints: tuple[str, ...]
    contract: PolicyContract
    reference: MotionReference
    policy: Policy
    control_period: float
    """s between two ticks; `policy_dt` is a whole multiple of it."""
    action_limit: float = ACTION_LIMIT
    """Largest magnitude of a raw action."""
    extern: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Name and width of the live observation terms."""
    decimation: int = field(init=False)
    """Ticks per inference."""
    layout: ObservationLayout = field(init=False, repr=False)
    action_map: ActionMap = field(init=False, repr=False)

    def __post_init__(self) -> None:
        owner = "RLPolicyController"
        set_field = object.__setattr__
        set_field(self, "joints", joint_tuple(owner, self.joints))
        set_field(self, "control_period", number(owner, "control_period", self.control_period, above=True))
        set_field(self, "action_limit", number(owner, "action_limit", self.action_limit, above=True))
        ratio = self.contract.policy_dt / self.control_period
        decimation = round(ratio)
        if decimation < 1 or abs(ratio - decimation) > _RATE_TOLERANCE * ratio:
            raise FieldError(
                f"{owner}.control_period: is {self.control_period:g} s, "
                f"expected policy_dt ({self.contract.policy_dt:g} s) to be a whole multiple of it"
            )
        set_field(self, "decimation", decimation)
        set_field(self, "action_map", resolve_action(self.contract, self.joints))
        layout = resolve_observation(self.contract, self.joints, self.reference, self.extern)
        set_field(self, "layout", layout)

    def activate(self, tick_input: TickInput) -> RLPolicyMemory | Fault:
        """Frame 0, no last action, and an inference due at once."""
        problem = self._state_problem(tick_input)
        if problem:
            return Fault(problem)
        return RLPolicyMemory(
            held_ticks=self.decimation,
            last_action=np.zeros(self.contract.action_count, dtype=np.float32),
            alignment=self._align(tick_input.state),
        )

    def _align(self, state: MITState) -> Alignment | None:
        """Nothing to align without anchor poses; a pose that is not known shows as a fault in the first observation."""
        live = state.extern.get(ANCHOR_POSE)
        if not self.contract.align_reference or "anchor_pos" not in self.reference.terms or live is None:
            return None
        return self.reference.align(live.value)

    def update(self, memory: RLPolicyMemory, tick_input: TickInput) -> tuple[RLPolicyMemory, MITCommand] | Fault:
        """The command of a new inference when one is due, else the last one."""
        problem = self._state_problem(tick_input)
        if problem:
            return Fault(problem)
        if memory.command is not None and memory.held_ticks < self.decimation:
            return replace(memory, policy_step=None, held_ticks=memory.held_ticks + 1), memory.command
        walked, phase = self._phase(memory, tick_input.state)
        context = ObservationContext(
            tick_input.state, memory.last_action, self.reference, memory.frame, memory.alignment, phase
        )
        try:
            observation, history = stack(self.layout, pack(self.layout, context), memory.history)
        except FieldError as error:
            return Fault(str(error))
        step = self._infer(observation, memory.frame)
        if isinstance(step, Fault):
            return step
        command = action_command(self.action_map, step.action)
        advanced = RLPolicyMemory(
            policy_step=step,
            frame=int(self.reference.clamp(memory.frame + 1)),
            held_ticks=1,
            last_action=step.action,
            command=command,
            history=history,
            walked=walked,
            alignment=memory.alignment,
        )
        return advanced, command

    def _phase(self, memory: RLPolicyMemory, state: MITState) -> tuple[float, FloatArray]:
        rule = self.contract.phase
        if rule is None:
            return 0.0, np.empty(0)
        walked, phase = advance_phase(rule, memory.walked, live_command(state, self.contract), self.contract.policy_dt)
        return float(walked), phase

    def _infer(self, observation: Float32Array, frame: int) -> PolicyStep | Fault:
        observation.setflags(write=False)
        if not np.isfinite(observation).all():
            i = int(np.argmax(~np.isfinite(observation)))
            return Fault(f"observation {self.layout.locate(i)} is {observation[i]}, expected a finite number")
        try:
            answer = self.policy(observation, frame)
            with np.errstate(over="ignore"):  # becomes infinite, and that is beyond any limit
                action = np.array(answer, dtype=np.float32)
        except Exception as error:  # the policy is foreign code: whatever it raises, the robot is damped in this tick
            return Fault(f"policy failed: {error}")
        action.setflags(write=False)
        step = PolicyStep(frame, observation, action)
        problem = self._action_problem(action)
        return Fault(problem, step) if problem else step

    def _state_problem(self, tick_input: TickInput) -> str:
        shape = tick_input.state.joint_position.shape
        if shape == (len(self.joints),):
            return ""
        return f"state has {shape} joint positions, expected ({len(self.joints)},)"

    def _action_problem(self, action: Float32Array) -> str:
        if action.shape != (self.contract.action_count,):
            return f"action has shape {action.shape}, expected ({self.contract.action_count},)"
        wrong = ~(np.abs(action) <= np.float64(self.action_limit))  # in float32 a large limit would be infinite
        if not wrong.any():
            return ""
        i = int(np.argmax(wrong))
        return (
            f"action of {self.contract.action_joint_names[i]} is {action[i]}, "
            f"expected a magnitude <= {self.action_limit:g}"
        )
