"""Sound stacks and controllers pass; each kind of mistake is found and named."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import pytest
import rig
import yaml
from hypothesis import Phase, settings
from hypothesis.stateful import run_state_machine_as_test

from humanoid_sim import testing
from humanoid_sim.assets import asset_path
from humanoid_sim.controllers import supervisor as supervisor_module
from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.fsm import Decision, transition
from humanoid_sim.messages import OK
from humanoid_sim.mit import MITCommand

QUICK = settings(testing.DEFAULT_SETTINGS, max_examples=3, derandomize=True, database=None)
SEARCH = settings(testing.DEFAULT_SETTINGS, max_examples=200, derandomize=True, database=None, phases=[Phase.generate])
"""Stops at the first find; shrinking it is Hypothesis's own work."""


@dataclass(frozen=True)
class Held:
    """A sound controller: it holds where it was activated. Its children are not sound."""

    fallback: ClassVar[str | None] = "damping_controller"
    joints: tuple[str, ...] = rig.JOINTS
    log: list = field(default_factory=list)

    def activate(self, tick_input):
        position = tick_input.state.joint_position
        sound = position.shape == (len(self.joints),) and (np.abs(position) < 10.0).all()
        return Memory() if sound else Fault("positions are not sound")

    def update(self, memory, tick_input):
        if isinstance(self.activate(tick_input), Fault):
            return Fault("positions are not sound")
        return memory, self.command(tick_input.state)

    def command(self, state):
        n = len(self.joints)
        return MITCommand(state.joint_position, np.zeros(n), np.zeros(n), np.full(n, 5.0), np.ones(n))


class Raises(Held):
    def activate(self, tick_input):
        if tick_input.state.joint_count != len(self.joints) or not np.isfinite(tick_input.state.joint_position).all():
            raise ValueError("positions are not sound")
        return Memory()


class PassesNaNOn(Held):
    def activate(self, tick_input):
        return Memory()


class IsNotPure(Held):
    def command(self, state):
        self.log.append(state)
        return replace(super().command(state), effort=np.full(3, 0.1 * len(self.log)))


class FaultsWithoutAWord(Held):
    def activate(self, tick_input):
        return Fault("") if isinstance(super().activate(tick_input), Fault) else Memory()


class GivesOnlyACommand(Held):
    def update(self, memory, tick_input):
        return self.command(tick_input.state) if tick_input.state.joint_count == 3 else Fault("width")


class GivesNoCommand(Held):
    def command(self, state):
        return state.joint_position


class ForgetsItself(Held):
    def update(self, memory, tick_input):
        result = super().update(memory, tick_input)
        return result if isinstance(result, Fault) else (None, result[1])


class ChangesItsMemory(Held):
    def activate(self, tick_input):
        fault = super().activate(tick_input)
        return fault if isinstance(fault, Fault) else []

    def update(self, memory, tick_input):
        memory.append(1.0)
        return super().update(memory, tick_input)


class NeverWorks(Held):
    def activate(self, tick_input):
        return Fault("not today")


MISTAKES = [
    (Raises, "raised"),
    (PassesNaNOn, "expected finite numbers"),
    (IsNotPure, "the same inputs gave"),
    (FaultsWithoutAWord, "a fault whose message is ''"),
    (GivesOnlyACommand, "expected a memory and a command"),
    (GivesNoCommand, "for a command"),
    (ForgetsItself, "update gave None for a memory"),
    (ChangesItsMemory, "what it was given changed"),
    (NeverWorks, "on a healthy robot: Fault(message='not today'"),
]


@pytest.mark.parametrize("name", sorted(rig.PATHS))
def test_the_packages_own_controllers_are_sound(name):
    externs = {"velocity": 3}
    controller = rig.supervisor().controllers[name]
    assert getattr(controller, "extern", externs) == externs
    testing.fuzz_controller(controller, settings(QUICK, max_examples=6), healthy_ticks=300)


@pytest.mark.parametrize(("kind", "message"), MISTAKES)
def test_a_mistake_in_a_controller_is_found(kind, message):
    with pytest.raises(testing.SafetyViolationError) as caught:
        testing.fuzz_controller(kind(), SEARCH, healthy_ticks=100)
    assert message in str(caught.value)


def without_safety(current, safety, intent, standby_finished, *rest):
    return transition(current, OK, intent, standby_finished, *rest)


def recovers(current, safety, intent, standby_finished, *rest):
    decision = transition(current, safety, intent, standby_finished, *rest)
    healthy = safety.is_ok and intent is None and current == "damping_controller"
    return Decision("standby_controller_a", message="recovered") if healthy else decision


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (without_safety, "although safety reports"),
        (recovers, "went to standby_controller_a by itself"),
    ],
)
def test_a_mistake_in_the_fsm_is_found(monkeypatch, rule, message):
    monkeypatch.setattr(supervisor_module, "transition", rule)
    with pytest.raises(testing.SafetyViolationError) as caught:
        testing.fuzz_stack(rig.supervisor, SEARCH, healthy_ticks=100)
    assert message in str(caught.value)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["lite", "lite_biped", "lite_neck"])
def test_every_shipped_robot_withstands_anything(name):
    testing.fuzz_stack(testing.robot_stack(name), settings(testing.DEFAULT_SETTINGS, max_examples=60))


def test_a_pose_that_takes_for_ever_is_found(tmp_path):
    document = yaml.safe_load(asset_path("robots", "lite.yaml").read_text(encoding="utf-8"))
    document["mjcf"] = str((asset_path("robots") / document["mjcf"]).resolve())
    document["standby_controller_a"]["segment_durations"] = [2.0, 20.0]
    path = tmp_path / "slow.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    with pytest.raises(testing.SafetyViolationError, match="standby_controller_a has not finished after 20"):
        testing.fuzz_stack(testing.robot_stack(path), SEARCH)


class OwnMachine(testing.StackMachine):
    """A property of one's own: this robot must never be told to move fast."""

    position = rig.KNOWN
    waiting_period = rig.PERIOD

    def build(self, policy):
        return rig.supervisor(policy)

    def check(self, given, output):
        super().check(given, output)
        assert np.abs(output.command.velocity).max() <= 1.0, "too fast"


def test_a_machine_of_ones_own_checks_more():
    with pytest.raises(AssertionError, match="too fast"):
        run_state_machine_as_test(OwnMachine, settings=SEARCH)
