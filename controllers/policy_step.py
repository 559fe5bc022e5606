"""One step of a policy on a robot, apart from the policy itself; shared by controller, environments and rollouts.

`observe`, the policy, `accepts`, `act`: everything takes `(..., n)`, one robot or a batch, and a batch gives bit for
bit what its robots give one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.action import ActionMap, action_command, resolve_action
from humanoid_sim.controllers.context import ANCHOR_POSE
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationContext, ObservationLayout, pack, resolve_observation, stack
from humanoid_sim.controllers.phase import advance_phase
from humanoid_sim.controllers.reference import Alignment, Frame, MotionReference
from humanoid_sim.controllers.sources import live_command, takes_velocity_command
from humanoid_sim.mit import FloatArray, MITCommand, MITState

__all__ = ["ACTION_LIMIT", "Policy", "PolicyMemory", "PolicyWiring"]

Float32Array = npt.NDArray[np.float32]

Policy = Callable[[Float32Array, int], npt.ArrayLike]
"""`(observation of shape (N,), reference frame) -> raw action of shape (m,)`. Same input, same output."""

ACTION_LIMIT = 100.0
"""Largest magnitude of a raw action unless another is given: trained policies stay within a few units, and beyond this
one has diverged."""


@dataclass(frozen=True, slots=True, eq=False)
class PolicyMemory:
    """What is carried from one policy step to the next."""

    frame: Frame
    """Shape (...), the reference frame that the next inference shows."""
    last_action: Float32Array
    """Shape (..., m), raw; zeros at activation."""
    history: Float32Array | None = None
    """Shape (..., h, step_width), what was observed in the last steps, oldest first; None before the first, or without
    terms that show one."""
    walked: FloatArray | float = 0.0
    """Shape (...), rad of gait phase since activation, or since standing."""
    alignment: Alignment | None = None
    """How the reference was laid onto the robot at activation."""


@dataclass(frozen=True, slots=True, eq=False)
class PolicyWiring:
    """A contract resolved on a robot: what its policy observes, and what its actions do.

    Raises:
        FieldError: at construction, if the contract does not fit the robot, or a term lacks its source.
    """

    joints: tuple[str, ...]
    """The robot's, in its order."""
    contract: PolicyContract
    reference: MotionReference
    extern: Mapping[str, int]
    """Name and width of the live inputs that states carry."""
    action_limit: float = ACTION_LIMIT
    """Largest magnitude of a raw action; beyond it the policy has failed."""
    layout: ObservationLayout = field(init=False, repr=False)
    action_map: ActionMap = field(init=False, repr=False)
    takes_velocity_command: bool = field(init=False, repr=False)
    """Whether what is observed depends on the velocity command."""

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        set_field(self, "action_map", resolve_action(self.contract, self.joints))
        set_field(self, "layout", resolve_observation(self.contract, self.joints, self.reference, self.extern))
        set_field(self, "takes_velocity_command", takes_velocity_command(self.contract))

    def activate(self, state: MITState) -> PolicyMemory:
        """Frame 0, no last action, and the reference laid onto the robot as it stands."""
        batch = state.joint_position.shape[:-1]
        return PolicyMemory(
            frame=np.zeros(batch, dtype=np.int64) if batch else 0,
            last_action=np.zeros((*batch, self.contract.action_count), dtype=np.float32),
            walked=np.zeros(batch) if batch else 0.0,
            alignment=self._align(state),
        )

    def _align(self, state: MITState) -> Alignment | None:
        """Nothing to align without anchor poses; a pose that is not known makes the first observation NaN."""
        live = state.extern.get(ANCHOR_POSE)
        if not self.contract.align_reference or "anchor_pos" not in self.reference.terms or live is None:
            return None
        return self.reference.align(live.value)

    def observe(self, memory: PolicyMemory, state: MITState) -> tuple[Float32Array, PolicyMemory]:
        """The observation, shape (..., N), and the memory with it.

        Raises:
            FieldError: a live input has another shape than it was resolved with.
        """
        rule, walked, phase = self.contract.phase, memory.walked, np.empty(0)
        if rule is not None:
            command = live_command(state, self.contract)
            walked, phase = advance_phase(rule, walked, command, self.contract.policy_dt)
        context = ObservationContext(state, memory.last_action, self.reference, memory.frame, memory.alignment, phase)
        observation, history = stack(self.layout, pack(self.layout, context), memory.history)
        if history is None and rule is None:
            return observation, memory
        return observation, PolicyMemory(memory.frame, memory.last_action, history, walked, memory.alignment)

    def observation_problem(self, observation: Float32Array) -> str:
        """Why one observation, shape (N,), must not reach the policy: a value is not finite; '' if it may."""
        finite = np.isfinite(observation)
        if finite.all():
            return ""
        i = int(np.argmin(finite))
        return f"observation {self.layout.locate(i)} is {observation[i]}, expected a finite number"

    def accepts(self, action: Float32Array) -> npt.NDArray[np.bool_]:
        """Shape (...): whether every value of a raw action, shape (..., m), is finite and within the limit."""
        return np.asarray(self._within(action).all(axis=-1))

    def action_problem(self, action: Float32Array) -> str:
        """Why one raw action, shape (m,), is not accepted; '' if it is."""
        if action.shape != (self.contract.action_count,):
            return f"action has shape {action.shape}, expected ({self.contract.action_count},)"
        within = self._within(action)
        if within.all():
            return ""
        i = int(np.argmin(within))
        joint = self.contract.action_joint_names[i]
        return f"action of {joint} is {action[i]}, expected a magnitude <= {self.action_limit:g}"

    def _within(self, action: Float32Array) -> npt.NDArray[np.bool_]:
        within: npt.NDArray[np.bool_] = np.abs(action) <= np.float64(self.action_limit)  # in float32 1e300 is infinite
        return within

    def act(self, memory: PolicyMemory, action: Float32Array) -> tuple[PolicyMemory, MITCommand]:
        """The command of an action, shape (..., m), and the memory with it, one frame on."""
        frame = self.reference.clamp(memory.frame + 1)
        advanced = PolicyMemory(frame, action, memory.history, memory.walked, memory.alignment)
        return advanced, action_command(self.action_map, action)
