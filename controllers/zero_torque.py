"""ZERO_TORQUE: alive but inert. The start, and the fallback that cannot fail."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from humanoid_sim.controllers.base import Memory
from humanoid_sim.controllers.parameters import joint_tuple
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import MITCommand

__all__ = ["ZeroTorqueController"]


@dataclass(frozen=True, slots=True, eq=False)
class ZeroTorqueController:
    """Writes 0 to all five fields of every joint, whatever the state."""

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
        """The same zeros every tick."""
        return memory, self._command
