"""REMOTE: apply the commands of an outside source, and damp the robot when that source falls silent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.damping import damped_command
from humanoid_sim.controllers.parameters import command_problem, time_problem
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import FloatArray, MITCommand

StaleCommandPolicy = Literal["passive", "hold"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RemoteMemory(Memory):
    """The command in force, and its age."""

    activation_time: float  # s, robot's clock
    time: float  # s, robot's clock at the previous tick
    stamp: float  # arrival time of the latest command, which tells it from the next; NaN before the first
    age: float = 0.0  # s since it arrived, summed tick by tick: a clock that jumps back makes no command young
    command: MITCommand | None = None  # None: none since activation


@dataclass(frozen=True, slots=True, eq=False)
class RemotePolicyController:
    """Applies the latest accepted `RemoteCommand` while it is fresh.

    Staleness is measured from arrival on the robot's clock. Commands that arrived before activation are never applied.
    """

    joints: tuple[str, ...]
    damping: FloatArray  # shape (n,), N·m·s/rad, of the passive hold
    stale_command_policy: StaleCommandPolicy = "passive"
    """`passive`: K_p 0 and `damping` at the live position. `hold`: the last command stays in force."""
    stale_command_timeout_ms: float = 100.0
    needs_producer: bool = False  # it starts only while commands arrive: nothing else keeps a floating base up

    def unready(self, tick_input: TickInput) -> str:
        """Return why it cannot start yet; '' if it can."""
        remote, timeout = tick_input.remote, 1e-3 * self.stale_command_timeout_ms
        arrives = remote is not None and abs(float(tick_input.state.time) - remote.arrival_time) <= timeout
        if arrives or not self.needs_producer:
            return ""
        silence = f"no remote command within the last {self.stale_command_timeout_ms:g} ms"
        return f"{silence}, and nothing else keeps a floating base on its feet; start a producer first"

    def activate(self, tick_input: TickInput) -> RemoteMemory | Fault:
        """Start the clock from which commands count."""
        if problem := time_problem(tick_input.state):
            return Fault(problem)
        time, remote = float(tick_input.state.time), tick_input.remote
        return RemoteMemory(activation_time=time, time=time, stamp=math.nan if remote is None else remote.arrival_time)

    def update(self, memory: RemoteMemory, tick_input: TickInput) -> tuple[RemoteMemory, MITCommand] | Fault:
        """Return the command in force, or the damped hold in its place."""
        state, remote = tick_input.state, tick_input.remote
        if problem := time_problem(state):
            return Fault(problem)
        time, begin = float(state.time), memory.activation_time
        command, stamp, age = memory.command, memory.stamp, memory.age + max(time - memory.time, 0.0)
        if remote is not None and remote.arrival_time != stamp and remote.arrival_time > begin:
            if problem := command_problem(remote.command, self.joints):
                return Fault(f"remote {problem}")
            command, stamp, age = remote.command, remote.arrival_time, max(time - remote.arrival_time, 0.0)
        timeout = 1e-3 * self.stale_command_timeout_ms
        fresh, was_fresh = command is not None and age <= timeout, memory.command is not None and memory.age <= timeout
        notice = "" if fresh == was_fresh else self._news(fresh)
        after = RemoteMemory(notice=notice, activation_time=begin, time=time, stamp=stamp, age=age, command=command)
        if command is not None and (fresh or self.stale_command_policy == "hold"):
            return after, command
        return after, damped_command(state.joint_position, self.damping)

    def _news(self, fresh: bool) -> str:
        if fresh:
            return "remote commands arrive and are in force"
        doing = "the last one is held" if self.stale_command_policy == "hold" else "the joints are damped"
        return f"no remote command for {self.stale_command_timeout_ms:g} ms: {doing}"
