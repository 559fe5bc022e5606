"""LOCOMOTION: run a learned policy at its own rate and hold its command in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import require
from humanoid_sim.controllers.policy_step import Policy, PolicyMemory, PolicyWiring
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import PolicyStep, TickInput
from humanoid_sim.mit import Float32Array, MITCommand

_RATE_TOLERANCE = 1e-6  # relative: periods are decimal fractions, which binary numbers round


def ticks_per_step(policy_dt: float, control_period: float) -> tuple[int, bool]:
    """Return the number of control periods in a policy's period, both in s, and True if it is whole."""
    ratio = policy_dt / control_period
    ticks = max(round(ratio), 1)
    return ticks, abs(ratio - ticks) <= _RATE_TOLERANCE * ratio


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RLPolicyMemory(Memory):
    """Position of the policy between two inferences, and its memory."""

    policy: PolicyMemory
    held_ticks: int  # ticks since the last inference; at `decimation` the next one is due
    command: MITCommand | None = None  # command of the last inference


@dataclass(frozen=True, slots=True, eq=False)
class RLPolicyController:
    """Observation → policy → action → command, once every `policy_dt`.

    A non-finite observation or action, a wrong size, an action beyond its limit, or a policy that raises is a fault,
    never a command.
    """

    joints: tuple[str, ...]
    contract: PolicyContract
    reference: MotionReference
    policy: Policy
    control_period: float  # s between two ticks; `policy_dt` is a whole multiple of it
    extern: Mapping[str, int] = field(default_factory=dict)  # name and width of the live observation terms
    decimation: int = field(init=False)  # ticks per inference
    wiring: PolicyWiring = field(init=False, repr=False)

    def __post_init__(self) -> None:
        policy_dt = self.contract.policy_dt
        decimation, is_whole = ticks_per_step(policy_dt, self.control_period)
        divisor = f"policy_dt ({policy_dt:g} s) to be a whole multiple of it"
        require(is_whole, "RLPolicyController.control_period", f"{self.control_period:g} s", divisor)
        wiring = PolicyWiring(self.joints, self.contract, self.reference, self.extern)
        object.__setattr__(self, "decimation", decimation)
        object.__setattr__(self, "wiring", wiring)

    def unready(self, tick_input: TickInput) -> str:
        """Return which live input the policy would miss if it started now, and why; '' for none."""
        state = tick_input.state
        for name, topic in self.contract.live_topics.items():
            live = state.extern.get(name)
            if live is None:
                return f"the live input '{name}' ({topic.name}) has not come yet"
            if not live.is_fresh(state.time).all():
                age = float(state.time) - live.arrival_time
                return f"the live input '{name}' ({topic.name}) is {age:.3g} s old, expected at most {live.timeout:g} s"
        return ""

    def activate(self, tick_input: TickInput) -> RLPolicyMemory:
        """Return a fresh memory, and an inference due at once."""
        return RLPolicyMemory(policy=self.wiring.activate(tick_input.state), held_ticks=self.decimation)

    def update(self, memory: RLPolicyMemory, tick_input: TickInput) -> tuple[RLPolicyMemory, MITCommand] | Fault:
        """Return the command of a new inference when one is due, else the last one."""
        if memory.command is not None and memory.held_ticks < self.decimation:
            held = RLPolicyMemory(policy=memory.policy, held_ticks=memory.held_ticks + 1, command=memory.command)
            return held, memory.command
        try:
            observation, observed = self.wiring.observe(memory.policy, tick_input.state)
        except FieldError as error:  # a live input of another shape
            return Fault(str(error))
        step = infer(self.wiring, self.policy, observation, int(observed.frame))
        if isinstance(step, Fault):
            return step
        advanced, command = self.wiring.act(observed, step.action)
        return RLPolicyMemory(policy_step=step, policy=advanced, held_ticks=1, command=command), command


def infer(wiring: PolicyWiring, policy: Policy, observation: Float32Array, frame: int) -> PolicyStep | Fault:
    """Return the raw action of one robot's observation, shape (N,), or what is wrong with either of them."""
    observation.setflags(write=False)
    if problem := wiring.observation_problem(observation):
        return Fault(problem)
    try:
        answer = np.asarray(policy(observation, frame))
        if answer.dtype.kind != "f":  # texts and integers would become numbers
            raise TypeError(f"answered values of type {answer.dtype}, expected floats")
        with np.errstate(over="ignore"):  # becomes infinite, and that is beyond any limit
            action = answer.astype(np.float32)
        action.setflags(write=False)
    except Exception as error:  # the policy is foreign code: whatever it raises, the robot is damped in this tick
        return Fault(f"policy failed: {error}", policy_error=str(error))
    step = PolicyStep(frame, observation, action)
    problem = wiring.action_problem(step.action)
    return Fault(problem, step) if problem else step
