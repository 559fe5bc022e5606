"""Every misbehaviour is one, for policies of any width and controllers of any limit."""

import numpy as np
import pytest
from models import contract_of

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.testing import ScriptedPolicy, healthy_tick, misbehaviours, well_behaved

NAMES = sorted(misbehaviours(1))


def controller(m, policy, action_limit):
    joints = tuple(f"joint_{i}" for i in range(m))
    contract = contract_of(joints, observation=("joint_pos", "actions"))
    return RLPolicyController(joints, contract, no_reference(), policy, 0.02, action_limit)


def answer_of(m, policy, action_limit=100.0):
    under_test = controller(m, policy, action_limit)
    tick = healthy_tick([0.5] * m, 1.0)
    return under_test.update(under_test.activate(tick), tick)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("m", "limit"), [(1, 100.0), (2, 5.0), (14, 100.0)])
def test_a_misbehaviour_is_a_fault(name, m, limit):
    policy = misbehaviours(m, limit)[name]
    assert repr(policy) == f"Misbehaviour(name='{name}')"
    assert isinstance(answer_of(m, policy, limit), Fault)


def test_a_scripted_policy_changes_its_mind_and_remembers_its_calls():
    policy = ScriptedPolicy(lambda *_: "left")
    seen = np.ones(2, dtype=np.float32)
    assert policy(seen, 4) == "left"
    policy.answer = well_behaved(2)
    assert np.abs(policy(seen, 5)).max() <= 1.0
    assert [(observation.tolist(), frame) for observation, frame in policy.calls] == [([1.0, 1.0], 4), ([1.0, 1.0], 5)]
