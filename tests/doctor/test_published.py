"""Published policies with their traces: right contracts are clean, planted mistakes are named."""

import pytest
from examine_plants import plants_of, published, search, trace_of
from plants import alike
from published import needs_policies

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
    wrong = plants_of(policy, right)[plant](right.contract) if plant else right.contract
    result = search(right, wrong, trace_of(policy))
    assert result.is_healthy is not bool(plant)
    assert not plant or alike(result.finding.contract, right.contract)
