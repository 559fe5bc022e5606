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
    """K_p 0 and K_d `damping` at `position`, which is 0 where it is unknown, or too far off to be sent.

    At K_p 0 the position exerts no torque; it is there because a command is always complete and finite.
    """
    zeros = np.zeros_like(damping)
    known = np.where(np.abs(position) <= LARGEST_COMMAND, position, 0.0)
    return MITCommand(position=known, velocity=zeros, effort=zeros, stiffness=zeros, damping=damping)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HeldMemory(Memory):
    """The command, fixed at activation."""

    command: MITCommand


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

    def activate(self, tick_input: TickInput) -> HeldMemory | Fault:
        """Capture the positions.

        Fails only if no joint's position is known: one silent wrist must not make thirteen healthy motors limp.
        """
        position = tick_input.state.joint_position
        problem = joints_problem(tick_input.state, self.joints)
        if problem:
            return Fault(problem)
        if not np.isfinite(position).any():
            return Fault("no joint position is known")
        return HeldMemory(command=damped_command(position, self.damping))

    def update(self, memory: HeldMemory, tick_input: TickInput) -> tuple[HeldMemory, MITCommand]:
        """Return the captured command, whatever the state is now."""
        return memory, memory.command


@dataclass(frozen=True, slots=True, eq=False)
class ZeroTorqueController:
    """Zeros in all five fields of every joint, whatever the state: the start, and the fallback that cannot fail."""

    fallback: ClassVar[str | None] = None

    joints: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", joint_tuple("ZeroTorqueController", self.joints))

    def activate(self, tick_input: TickInput) -> HeldMemory:
        """Make the zeros."""
        return HeldMemory(command=MITCommand.zeros(len(self.joints)))

    def update(self, memory: HeldMemory, tick_input: TickInput) -> tuple[HeldMemory, MITCommand]:
        """Return the same zeros every tick."""
        return memory, memory.command
