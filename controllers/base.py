"""Interface of controllers: a frozen configuration with two pure functions, and errors that are values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from humanoid_sim.messages import PolicyStep, StandbyState, TickInput
from humanoid_sim.mit import MITCommand

ZERO_TORQUE = "zero_torque_controller"
DAMPING = "damping_controller"
STANDBY_A = "standby_controller_a"
STANDBY_B = "standby_controller_b"
RL_POLICY = "rl_policy_controller"
REMOTE_POLICY = "remote_policy_controller"


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """State that a controller carries from one tick to the next, and its report besides the command."""

    standby: StandbyState | None = None
    policy_step: PolicyStep | None = None  # set only in the tick in which the policy ran
    notice: str = ""  # message to the operator about this tick; set only in the tick in which it is news


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """Failure of a controller, returned in place of a result: DAMPING, or else ZERO_TORQUE, takes over in that tick."""

    message: str
    policy_step: PolicyStep | None = None  # input and output of the policy, if they are what went wrong
    policy_error: str | None = None  # error that the policy raised, if that is what went wrong
    is_bug: bool = False  # set by the supervisor for a controller that raised


class Controller(Protocol):
    """One way of commanding every joint. Memories are `Memory` or a subclass; states have the robot's joints."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names in the order of every per-joint array."""

    def activate(self, tick_input: TickInput) -> Any | Fault:
        """Return the memory to start from. Called in the tick of the transition, before the first `update`."""

    def update(self, memory: Any, tick_input: TickInput) -> tuple[Any, MITCommand] | Fault:
        """Return the next memory, and a command for every joint."""
