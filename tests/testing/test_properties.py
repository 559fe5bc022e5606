"""Each safety property, broken by hand: a check that nothing breaks says nothing."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import rig

from humanoid_sim.messages import ControlMode, FaultReport, Intent, Mode, RemoteCommand, StandbyState
from humanoid_sim.testing import SafetyViolationError
from humanoid_sim.testing.properties import SafetyProperties

ZERO, DAMPING, A = "zero_torque_controller", "damping_controller", "standby_controller_a"
RL, REMOTE = "rl_policy_controller", "remote_policy_controller"


class WatchedRun(rig.Run):
    """Every tick is checked on the way to where a property is to be broken."""

    def __post_init__(self):
        super().__post_init__()
        self.properties = SafetyProperties(self.supervisor)

    def step(self, *intents, **inputs):
        given, output = self.next(*intents, **inputs)
        self.memory, _ = self.supervisor.step(self.memory, given)
        self.properties.check(given, output)
        self.time += rig.PERIOD
        return output

    def next(self, *intents, **inputs):
        """The next tick and its right output, not checked yet."""
        given = rig.tick(self.time, *intents, **inputs)
        return given, self.supervisor.step(self.memory, given)[1]


def command(output, **changes):
    return replace(output, command=replace(output.command, **changes))


def mode(output, mode, name):
    return replace(output, control_mode=ControlMode(mode, name, ""))


def fault(output, **changes):
    return replace(output, faults=(replace(FaultReport(RL, DAMPING, "NaN"), **changes),))


STANDBY = StandbyState(1, 2, 1.0, True)
QUIT, DAMP, LOAD_A, LOAD_B = Intent.QUIT, Intent.DAMP, Intent.LOAD_A, Intent.LOAD_B
START = Intent.START_LOCOMOTION
BROKEN = [  # in control, intents or inputs, what is done to the output, what is found
    (DAMPING, (), lambda o: command(o, damping=[-1.0, 1.0, 1.0]), "no negative gain"),
    (ZERO, (), lambda o: command(o, effort=[0, 0, 1e-9]), "ZERO_TORQUE's command is"),
    (DAMPING, (), lambda o: command(o, stiffness=np.ones(3)), "DAMPING's stiffness is [1. 1. 1.]"),
    (DAMPING, (), lambda o: command(o, position=np.ones(3)), "captured at activation"),
    (DAMPING, (), lambda o: mode(o, Mode.REMOTE, DAMPING), "reports mode REMOTE"),
    (DAMPING, (), lambda o: replace(o, standby=STANDBY), "DAMPING with standby"),
    (RL, (DAMP,), lambda o: mode(o, Mode.LOCOMOTION, RL), "DAMP was requested, and rl_policy"),
    (DAMPING, (START,), lambda o: mode(o, Mode.LOCOMOTION, RL), "which is not an edge"),
    (DAMPING, (LOAD_B,), lambda o: mode(replace(o, standby=STANDBY), Mode.STANDBY, A), "without Intent.LOAD_A"),
    (DAMPING, (QUIT, DAMP), lambda o: replace(o, quit=True), "although DAMP came with it"),
    (RL, (QUIT,), lambda o: replace(o, quit=True), "QUIT was obeyed from rl_policy"),
    (RL, (QUIT,), lambda o: replace(o, refusals=()), "no refusal says why"),
    (RL, {"policy": "dance"}, lambda o: replace(o, refusals=()), "policy dance was selected in rl_policy_controller"),
    (RL, (), fault, "failed and stays in control"),
    (DAMPING, (), fault, "is not in the status message"),
    (DAMPING, (), lambda o: fault(o, is_bug=True), "raised: NaN"),
    (DAMPING, (), lambda o: fault(o, fallback=ZERO), "damping_controller leads"),
    (A, (), lambda o: command(o, stiffness=2 * o.command.stiffness), "expected one share"),
    (DAMPING, (LOAD_A,), lambda o: command(o, stiffness=[5, 5.5, 6], damping=[0.5, 0.55, 0.6]), "with 0.5 of its gain"),
    (RL, (), lambda o: command(o, position=o.command.position + 1.0), "joints that its policy does not drive"),
    (REMOTE, (), lambda o: replace(o, command=rig.command()), "no command has arrived since"),
]


@pytest.mark.parametrize(("name", "given", "tamper", "message"), BROKEN, ids=[row[-1] for row in BROKEN])
def test_a_broken_property_is_found(name, given, tamper, message):
    run = WatchedRun(rig.supervisor())
    run.walk(*rig.PATHS[name])
    given, output = run.next(**given) if isinstance(given, dict) else run.next(*given)
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
