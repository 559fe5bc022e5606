"""The supervisor against anything: Hypothesis drives it with hostile inputs and checks every tick."""

import pytest
import rig
from hypothesis import settings

from humanoid_sim.testing import DEFAULT_SETTINGS, fuzz_stack

pytestmark = pytest.mark.timeout(1800)  # shrinking a failure to its few steps takes up to five minutes


@pytest.mark.parametrize(
    ("count", "is_repeatable"), [(5, True), pytest.param(300, False, marks=pytest.mark.soak)], ids=["short", "long"]
)
def test_the_supervisor_withstands_anything(count, is_repeatable):
    """Where examples are new in every run, a failure prints how to repeat it."""
    chosen = settings(DEFAULT_SETTINGS, max_examples=count, derandomize=is_repeatable)
    fuzz_stack(lambda policy: rig.two_policies(policy, policy), chosen)
