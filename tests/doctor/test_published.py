"""Published policies with their traces: right contracts are clean, planted mistakes are named."""

from dataclasses import replace

import pytest
from plants import alike, plants_of
from published import needs_policies
from published_policies import published, trace_of

from humanoid_sim.doctor.edits import isaac_order
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import search_trace

pytestmark = needs_policies


@pytest.mark.parametrize(
    ("policy", "plant"),
    [
        ("berkeley", ""),
        ("playground", ""),
        ("berkeley", "sign of a joint"),
        ("berkeley", "default pose zero"),
        ("playground", "gains in another order"),
        ("holosoma", "25 Hz"),
        ("waltz", "quaternion order"),
    ],
)
def test_a_planted_mistake_is_named_first_and_a_right_contract_is_clean(tmp_path, policy, plant):
    right = published(policy, tmp_path)
    plants = plants_of(policy, right.description.joint_names, isaac_order(right.description))
    wrong = plants[plant](right.contract) if plant else right.contract
    subject = replace(right, contract=wrong, motion=right.motion_under(wrong))
    result = search_trace(subject, Samples(subject, trace_of(policy)))
    assert result.is_healthy is not bool(plant)
    assert not plant or alike(result.finding.contract, right.contract)
