"""DAMPING and ZERO_TORQUE: where every other mode falls back to, and where it starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.parameters import LARGEST_COMMAND
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import FloatArray, MITCommand


def damped_command(position: FloatArray, damping: FloatArray) -> MITCommand:
    """Return K_p 0 and K_d `damping` at `position`, which is 0 where it is unknown, or too far off to be sent.

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
    """Holds the joint positions of its activation with damping only: soft under gravity, viscous against motion."""

    joints: tuple[str, ...]
    damping: FloatArray  # shape (n,), N·m·s/rad

    def activate(self, tick_input: TickInput) -> HeldMemory | Fault:
        """Capture the positions; fails only if none is known: one silent joint must not make the others limp."""
        position = tick_input.state.joint_position
        if not np.isfinite(position).any():
            return Fault("no joint position is known")
        return HeldMemory(command=damped_command(position, self.damping))

    def update(self, memory: HeldMemory, tick_input: TickInput) -> tuple[HeldMemory, MITCommand]:
        """Return the held command, whatever the state is now."""
        return memory, memory.command


@dataclass(frozen=True, slots=True, eq=False)
class ZeroTorqueController:
    """Zeros in all five fields of every joint, whatever the state: the start, and the fallback that cannot fail."""

    joints: tuple[str, ...]

    def activate(self, tick_input: TickInput) -> Memory:
        return Memory()

    def update(self, memory: Memory, tick_input: TickInput) -> tuple[Memory, MITCommand]:
        return memory, MITCommand.zeros(len(self.joints))
