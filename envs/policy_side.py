"""What the deployed policy controller does around its policy, for one robot or a batch of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.action import action_command, resolve_action
from humanoid_sim.controllers.context import ANCHOR_POSE
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationContext, pack, resolve_observation, stack
from humanoid_sim.controllers.phase import advance_phase
from humanoid_sim.controllers.reference import Alignment, Frame, MotionReference
from humanoid_sim.controllers.sources import live_command
from humanoid_sim.mit import FloatArray, MITCommand, MITState

__all__ = ["PolicyMemory", "PolicySide"]

Float32Array = npt.NDArray[np.float32]

_COMMANDED = frozenset({"command", "velocity_command", "command_lin_vel", "command_ang_vel"})
_NO_PHASE: FloatArray = np.empty(0)


@dataclass(frozen=True, slots=True, eq=False)
class PolicyMemory:
    """What is carried from one policy step to the next: the batched part of the controller's `RLPolicyMemory`."""

    frame: Frame
    """Shape (...), the reference frame that the next inference shows."""
    last_action: Float32Array
    """Shape (..., m), raw; zeros at the start."""
    history: Float32Array | None = None
    """Shape (..., h, step_width), oldest first; None before the first observation, or without."""
    walked: FloatArray | float = 0.0
    """Shape (...), rad of gait phase."""
    alignment: Alignment | None = None
    """How the reference was laid onto the robot at the start."""


class PolicySide:
    """Observation, action and reference of a contract on a robot, by the functions that the deployed controller uses.

    One policy step of `RLPolicyController` is `observe`, the policy, `act`.
    """

    def __init__(
        self,
        joints: tuple[str, ...],
        contract: PolicyContract,
        reference: MotionReference,
        extern: Mapping[str, int],
        action_limit: float,
    ) -> None:
        """Match names.

        Args:
            joints: the robot's, in its order.
            contract: of the policy.
            reference: of its motion.
            extern: name and width of the live inputs that states carry.
            action_limit: largest magnitude of a raw action; beyond it the policy has failed.

        Raises:
            FieldError: the contract does not fit the robot.
        """
        self.contract = contract
        self.reference = reference
        self.action_limit = action_limit
        self.action_map = resolve_action(contract, joints)
        self.layout = resolve_observation(contract, joints, reference, extern)
        kinds = {term.kind for term in contract.terms}
        self.takes_command = bool(kinds & _COMMANDED) or contract.phase is not None
        """Whether what is observed depends on the velocity command."""

    def activate(self, state: MITState) -> PolicyMemory:
        """Frame 0, no last action, and the reference laid onto the robot as it stands."""
        batch = state.joint_position.shape[:-1]
        return PolicyMemory(
            frame=np.zeros(batch, dtype=np.int64) if batch else 0,
            last_action=np.zeros((*batch, self.contract.action_count), dtype=np.float32),
            walked=np.zeros(batch),
            alignment=self._align(state),
        )

    def observe(self, memory: PolicyMemory, state: MITState) -> tuple[Float32Array, PolicyMemory]:
        """The observation, shape (..., N), and the memory after it."""
        walked, phase = memory.walked, _NO_PHASE
        if self.contract.phase is not None:
            command = live_command(state, self.contract)
            walked, phase = advance_phase(self.contract.phase, walked, command, self.contract.policy_dt)
        context = ObservationContext(state, memory.last_action, self.reference, memory.frame, memory.alignment, phase)
        observation, history = stack(self.layout, pack(self.layout, context), memory.history)
        if history is None and self.contract.phase is None:
            return observation, memory
        return observation, replace(memory, history=history, walked=walked)

    def accepts(self, action: Float32Array) -> npt.NDArray[np.bool_]:
        """Shape (...): whether every value of a raw action, shape (..., m), is finite and within the limit."""
        return np.asarray((np.abs(action) <= self.action_limit).all(axis=-1))

    def refusal(self, action: Float32Array) -> str:
        """Why one action, shape (m,), is not accepted."""
        i = int(np.argmin(np.abs(action) <= self.action_limit))
        joint = self.contract.action_joint_names[i]
        return f"action of {joint} is {action[i]}, expected a magnitude <= {self.action_limit:g}"

    def outlier(self, observation: Float32Array, inside: npt.NDArray[np.bool_]) -> str:
        """What lies outside of its bounds in one observation, shape (N,); `inside` says which values do not."""
        i = int(np.argmin(inside))
        return f"observation {self.layout.locate(i)} is {observation[i]}, beyond any robot's"

    def act(self, memory: PolicyMemory, action: Float32Array) -> tuple[PolicyMemory, MITCommand]:
        """The command of an action, shape (..., m), and the memory with it, one frame on."""
        command = action_command(self.action_map, action)
        return replace(memory, frame=self.reference.clamp(memory.frame + 1), last_action=action), command

    def _align(self, state: MITState) -> Alignment | None:
        live = state.extern.get(ANCHOR_POSE)
        if not self.contract.align_reference or "anchor_pos" not in self.reference.terms or live is None:
            return None
        return self.reference.align(live.value)
