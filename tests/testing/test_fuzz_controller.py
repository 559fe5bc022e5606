"""Sound controllers pass; each kind of mistake of a controller by itself is found and named."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import rig
from hypothesis import Phase, settings

from humanoid_sim import testing
from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.damping import DampingController
from humanoid_sim.mit import MITCommand

QUICK = settings(testing.DEFAULT_SETTINGS, max_examples=6, derandomize=True, database=None)
SEARCH = settings(QUICK, max_examples=200, phases=[Phase.generate])


@dataclass(frozen=True)
class Held:
    """A sound controller: it holds where it was activated. Its children are not sound."""

    joints: tuple[str, ...] = rig.JOINTS
    log: list = field(default_factory=list)

    def activate(self, tick_input):
        sound = (np.abs(tick_input.state.joint_position) < 10.0).all()
        return Memory() if sound else Fault("positions are not sound")

    def update(self, memory, tick_input):
        fault = self.activate(tick_input)
        return fault if isinstance(fault, Fault) else (memory, self.command(tick_input.state))

    def command(self, state):
        zeros = np.zeros(len(self.joints))
        return MITCommand(state.joint_position, zeros, zeros, zeros + 5.0, zeros + 1.0)


class Raises(Held):
    def activate(self, tick_input):
        if not np.isfinite(tick_input.state.joint_position).all():
            raise ValueError("positions are not sound")
        return super().activate(tick_input)


class PassesNaNOn(Held):
    def activate(self, tick_input):
        return Memory()


class IsNotPure(Held):
    def command(self, state):
        self.log.append(state)
        return replace(super().command(state), effort=np.full(3, 0.1 * len(self.log)))


class AnswersACommandAlone(Held):
    def update(self, memory, tick_input):
        return self.command(tick_input.state)


class FaultsWithoutAWord(Held):
    def activate(self, tick_input):
        return Fault("") if isinstance(super().activate(tick_input), Fault) else Memory()


class FailsInTime(DampingController):
    __slots__ = ()

    def update(self, memory, tick_input):
        return Fault("tired") if tick_input.state.time > 40.0 else super().update(memory, tick_input)


@pytest.mark.parametrize("name", sorted(rig.PATHS))
def test_the_packages_own_controllers_are_sound(name):
    testing.fuzz_controller(rig.supervisor().controllers[name], QUICK)


@pytest.mark.parametrize(
    ("controller", "message"),
    [
        (Raises(), "raised ValueError"),
        (PassesNaNOn(), "expected"),
        (IsNotPure(), "the same inputs gave"),
        (AnswersACommandAlone(), "the answer is MITCommand"),
        (FaultsWithoutAWord(), "a fault whose message is ''"),
        (FailsInTime(rig.JOINTS, np.ones(3)), "in tick 1501"),
    ],
)
def test_a_mistake_is_found(controller, message):
    with pytest.raises(testing.SafetyViolationError) as caught:
        testing.fuzz_controller(controller, SEARCH)
    assert message in str(caught.value)
