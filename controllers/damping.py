"""DAMPING and ZERO_TORQUE: where every other mode falls back to, and where it starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from humanoid_sim.controllers.base import ZERO_TORQUE, Fault, Memory
from humanoid_sim.controllers.parameters import LARGEST_COMMAND, damping_values, joint_tuple, joints_problem
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import FloatArray, MITCommand


def damped_command(position: FloatArray, damping: FloatArray) -> MITCommand:
    """K_p 0 and K_d `damping` at `position`, which is 0 where it is not known, or is so absurd that none may be sent.

    At K_p 0 the position exerts no torque; it is there because a command is always complete and finite.
    """
    zeros = np.zeros_like(damping)
    known = np.where(np.abs(position) <= LARGEST_COMMAND, position, 0.0)
    return MITCommand(position=known, velocity=zeros, effort=zeros, stiffness=zeros, damping=damping)


@dataclass(frozen=True, slots=True, eq=False)
class DampingMemory(Memory):
    """The command, fixed at activation."""

    command: MITCommand | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DampingController:
    """Captures the joint positions at activation and holds them with damping only.

    Soft under gravity, viscous against motion.
    """

    fallback: ClassVar[str | None] = ZERO_TORQUE

    joints: tuple[str, ...]
    damping: FloatArray = field(default_factory=lambda: np.empty(0))
    """Shape (n,), N·m·s/rad; empty: `damping_scalar` for every joint."""
    damping_scalar: float = 1.0
    """N·m·s/rad"""

    def __post_init__(self) -> None:
        owner = "DampingController"
        object.__setattr__(self, "joints", joint_tuple(owner, self.joints))
        object.__setattr__(self, "damping", damping_values(owner, self.damping, self.damping_scalar, self.joints))

    def activate(self, tick_input: TickInput) -> DampingMemory | Fault:
        """Capture the positions.

        Faults only if no joint was ever heard: one silent wrist, or one absurd reading, must not make thirteen healthy
        motors limp.
        """
        position = tick_input.state.joint_position
        problem = joints_problem(tick_input.state, self.joints)
        if problem:
            return Fault(problem)
        if not np.isfinite(position).any():
            return Fault("no joint position is known")
        return DampingMemory(command=damped_command(position, self.damping))

    def update(self, memory: DampingMemory, tick_input: TickInput) -> tuple[DampingMemory, MITCommand] | Fault:
        """Return the captured command; it depends on no later state."""
        if memory.command is None:
            return Fault("not activated")
        return memory, memory.command


@dataclass(frozen=True, slots=True, eq=False)
class ZeroTorqueController:
    """Writes 0 to all five fields of every joint, whatever the state: the start, and the fallback that cannot fail."""

    fallback: ClassVar[str | None] = None

    joints: tuple[str, ...]
    _command: MITCommand = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", joint_tuple("ZeroTorqueController", self.joints))
        object.__setattr__(self, "_command", MITCommand.zeros(len(self.joints)))

    def activate(self, tick_input: TickInput) -> Memory:
        """Nothing to remember."""
        return Memory()

    def update(self, memory: Memory, tick_input: TickInput) -> tuple[Memory, MITCommand]:
        """Return the same zeros every tick."""
        return memory, self._command
