"""Each safety property, broken by hand: a check that nothing breaks says nothing."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import rig

from humanoid_sim.messages import (
    ControlMode,
    FaultReport,
    Intent,
    Mode,
    RemoteCommand,
    SafetyFlag,
    SafetyLevel,
    SafetyStatus,
    StandbyState,
)
from humanoid_sim.testing import SafetyProperties, SafetyViolationError

ZERO, DAMPING, A, RL, REMOTE = (
    "zero_torque_controller",
    "damping_controller",
    "standby_controller_a",
    "rl_policy_controller",
    "remote_policy_controller",
)
FAULT = (SafetyStatus(SafetyLevel.FAULT, SafetyFlag.MOTOR_FAULT, "can0", "over-current"),)


class WatchedRun(rig.Run):
    """Every tick is checked on the way to where a property is to be broken."""

    def __post_init__(self):
        super().__post_init__()
        self.properties = SafetyProperties(self.supervisor)

    def step(self, *intents, **inputs):
        self.given = rig.tick(self.time, *intents, **inputs)
        self.memory, output = self.supervisor.step(self.memory, self.given)
        self.properties.check(self.given, output)
        self.time += rig.PERIOD
        return output

    def next(self, *intents, **inputs):
        """The next tick and its right output, not checked yet."""
        given = rig.tick(self.time, *intents, **inputs)
        return given, self.supervisor.step(self.memory, given)[1]


def at(name):
    run = WatchedRun(rig.supervisor())
    run.walk(*rig.PATHS[name])
    return run


def with_command(output, **changes):
    return replace(output, command=replace(output.command, **changes))


def with_mode(output, mode, name, message=""):
    return replace(output, control_mode=ControlMode(mode, name, message))


STANDBY = StandbyState(1, 2, 1.0, True)
REPORT = FaultReport(RL, DAMPING, "NaN")


def row(name, tamper, message, *intents, **inputs):
    """In control, what is done to the output, what is found, and what comes in."""
    return name, intents, inputs, tamper, message


BROKEN = {
    "negative gain": row(DAMPING, lambda o: with_command(o, damping=[-1.0, 1.0, 1.0]), "no negative gain"),
    "torque in ZERO_TORQUE": row(ZERO, lambda o: with_command(o, effort=[0, 0, 1e-9]), "ZERO_TORQUE's command is"),
    "stiff DAMPING": row(DAMPING, lambda o: with_command(o, stiffness=np.ones(3)), "DAMPING's stiffness is [1. 1. 1.]"),
    "DAMPING follows": row(DAMPING, lambda o: with_command(o, position=np.ones(3)), "captured at activation"),
    "wrong mode": row(DAMPING, lambda o: with_mode(o, Mode.REMOTE, DAMPING), "reports mode REMOTE"),
    "standby elsewhere": row(DAMPING, lambda o: replace(o, standby=STANDBY), "DAMPING with standby"),
    "DAMP is not heard": row(
        RL,
        lambda o: with_mode(o, Mode.LOCOMOTION, RL),
        "DAMP was requested, and rl_policy_controller is in control",
        Intent.DAMP,
    ),
    "no such edge": row(
        DAMPING, lambda o: with_mode(o, Mode.LOCOMOTION, RL), "which is not an edge", Intent.START_LOCOMOTION
    ),
    "another intent": row(
        DAMPING,
        lambda o: with_mode(replace(o, standby=STANDBY), Mode.STANDBY, A),
        "without Intent.LOAD_A",
        Intent.LOAD_B,
    ),
    "quits although DAMP": row(
        DAMPING, lambda o: replace(o, quit=True), "although DAMP came with it", Intent.QUIT, Intent.DAMP
    ),
    "quits while moving": row(RL, lambda o: replace(o, quit=True), "QUIT was obeyed from rl_policy", Intent.QUIT),
    "QUIT says nothing": row(RL, lambda o: replace(o, refusals=()), "no refusal says why", Intent.QUIT),
    "selection says nothing": row(
        RL, lambda o: replace(o, refusals=()), "policy dance was selected in rl_policy_controller", policy="dance"
    ),
    "failed and stays": row(RL, lambda o: replace(o, faults=(REPORT,)), "failed and stays in control"),
    "failure not told": row(DAMPING, lambda o: replace(o, faults=(REPORT,)), "is not in the status message"),
    "raised": row(DAMPING, lambda o: replace(o, faults=(replace(REPORT, is_bug=True),)), "raised: NaN"),
    "other fallback": row(
        DAMPING, lambda o: replace(o, faults=(replace(REPORT, fallback=ZERO),)), "damping_controller leads"
    ),
    "gains too high": row(
        A,
        lambda o: with_command(o, stiffness=2 * o.command.stiffness, damping=2 * o.command.damping),
        "expected one share of",
    ),
    "gains begin high": row(
        DAMPING,
        lambda o: with_command(o, stiffness=[5.0, 5.5, 6.0], damping=[0.5, 0.55, 0.6]),
        "STANDBY began with 0.5 of its gains",
        Intent.LOAD_A,
    ),
    "pinned joint": row(
        RL,
        lambda o: with_command(o, position=o.command.position + 1.0),
        "LOCOMOTION moves joints that its policy does not drive",
    ),
    "nobody's command": row(REMOTE, lambda o: replace(o, command=rig.command()), "no command has arrived since"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_property_is_found(what):
    name, intents, inputs, tamper, message = BROKEN[what]
    run = at(name)
    given, output = run.next(*intents, **inputs)
    copy.copy(run.properties).check(given, output)
    with pytest.raises(SafetyViolationError) as caught:
        run.properties.check(given, tamper(output))
    assert message in str(caught.value)


@pytest.mark.parametrize("policy", ["passive", "hold"])
def test_a_stale_remote_command(policy):
    controller = replace(rig.supervisor().controllers[REMOTE], stale_command_policy=policy)
    run = WatchedRun(rig.supervisor(**{REMOTE: controller}))
    run.walk(*rig.PATHS[REMOTE])
    run.time += rig.PERIOD
    remote = RemoteCommand(rig.command(), run.time)
    assert run.step(remote=remote).command.stiffness.any()
    run.time += 0.2
    given, output = run.next(remote=remote)
    stale = replace(output, command=remote.command)
    if policy == "hold":
        run.properties.check(given, stale)
    else:
        with pytest.raises(SafetyViolationError, match="expected the passive hold"):
            run.properties.check(given, stale)
