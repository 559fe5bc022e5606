"""A run of the real control stack through all five modes, for tests of replay."""

from functools import cache

import numpy as np

from humanoid_sim import messages
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor, run_header

PERIOD = 0.02
INTENTS = {
    1: messages.Intent.DAMP,
    2: messages.Intent.LOAD_A,
    3: messages.Intent.LOAD_B,  # refused
    210: messages.Intent.START_LOCOMOTION,
    260: messages.Intent.LOAD_B,
    480: messages.Intent.START_REMOTE,
    540: messages.Intent.QUIT,
}
COUNT = 560
HEALTHY = messages.SafetyStatus(source="can0")
FAULT = messages.SafetyStatus(messages.SafetyLevel.FAULT, messages.SafetyFlag.RX_TIMEOUT, "can0", "wrist")


class Wobble:
    """A policy that uses what it sees, and breaks: in its 21st answer with a NaN."""

    calls = 0

    def __call__(self, observation, frame):
        self.calls += 1
        action = np.tanh(observation[:14] + 0.1 * np.sin(0.3 * self.calls)).astype(np.float32)
        if self.calls == 21:
            action[3] = np.nan
        return action


def run(policy) -> tuple[messages.SessionHeader, list[messages.TickRecord]]:
    """A run through all five modes on a robot that obeys at once, with faults of every kind on the way."""
    description = load_robot("lite")
    checkpoint = placeholder_checkpoint(description, policy_dt=2 * PERIOD)
    loaded = load_policy(checkpoint.contract, policy, None)
    supervisor = build_supervisor(description, PERIOD, loaded, remote=True)
    joints = len(description.joint_names)
    rng = np.random.default_rng(0)
    memory, ticks, remote = supervisor.initial(), [], None
    position = np.zeros(joints)
    for index in range(COUNT):
        time = index * PERIOD
        noise = 1e-3 * rng.normal(size=(3, joints))
        state = MITState(
            time, position + noise[0], noise[1], noise[2], np.zeros(joints), [1, 0, 0, 0], np.zeros(3), [0, 0, 9.81]
        )
        if index >= 500 and index % 3 == 0:
            position, *others = rng.normal(size=(5, joints)) ** 2
            within = -0.5 * np.tanh(position)  # every joint's limits: the guards would end REMOTE
            remote = messages.RemoteCommand(MITCommand(within, *others), time - 0.001)
        intent = INTENTS.get(index)
        status = FAULT if index == 530 else HEALTHY
        tick_input = messages.TickInput(state, (status,), (intent,) if intent else (), remote)
        memory, output = supervisor.step(memory, tick_input)
        ticks.append(messages.TickRecord(index, tick_input, output, 1e-4, False))
        position = output.command.position
    return run_header(description, PERIOD, loaded, settings={"policy": "placeholder"}, remote=True), ticks


@cache
def wobbled() -> tuple[messages.SessionHeader, tuple[messages.TickRecord, ...]]:
    """Such a run of the policy that breaks by itself."""
    header, ticks = run(Wobble())
    return header, tuple(ticks)
