"""The supervisor against anything: Hypothesis drives it with hostile inputs and checks every tick."""

import pytest
import rig
from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test

from humanoid_sim.testing import DEFAULT_SETTINGS, StackMachine

pytestmark = pytest.mark.timeout(1800)  # shrinking a failure to its few steps takes up to five minutes


class RigMachine(StackMachine):
    """The small stack of the tests, with two policies."""

    def build(self, policy):
        return rig.two_policies(policy, policy)


def test_the_supervisor_withstands_anything():
    run_state_machine_as_test(RigMachine, settings=settings(DEFAULT_SETTINGS, max_examples=5, derandomize=True))


@pytest.mark.soak
def test_the_supervisor_withstands_anything_for_longer():
    """New examples in every run; a failure prints how to repeat it."""
    run_state_machine_as_test(RigMachine, settings=settings(DEFAULT_SETTINGS, max_examples=300))
