"""Bounds of observations and actions."""

from dataclasses import replace

import numpy as np

from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.terms import Term
from humanoid_sim.envs.spaces import action_space, outlier
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.robots.description import load_robot


def wiring(action_limit=100.0, **terms):
    contract = placeholder_checkpoint(load_robot("lite")).contract
    observation = tuple(Term(name, history=history) for name, history in terms.items()) or contract.observation
    return PolicyWiring(
        contract.joint_names, replace(contract, observation=observation), no_reference(), {}, action_limit
    )


def test_what_lies_outside_is_named():
    wired = wiring(joint_pos=3)
    observation = np.zeros(wired.layout.width, dtype=np.float32)
    observation[15] = 7.5
    message = "observation joint_pos[1] of history step 1 is 7.5, beyond any robot's"
    assert outlier(wired, observation, observation < 5.0) == message


def test_no_action_within_its_bounds_is_refused():
    """As a float32, 0.1 is larger than the limit itself."""
    wired = wiring(action_limit=0.1)
    space = action_space(wired, load_robot("lite"))
    assert wired.accepts(space.high)
    assert wired.accepts(space.low)
    np.testing.assert_allclose(space.high, 0.1, rtol=1e-6)
    assert not wired.accepts(np.full_like(space.high, 0.1))
