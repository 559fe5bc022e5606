"""Published policies with their traces: right contracts are clean, planted mistakes are named."""

from dataclasses import replace

import pytest
from plants import alike, plants_of, term
from published import needs_policies
from published_policies import FILES, published, trace_of

from humanoid_sim.doctor.edits import isaac_order
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import search_trace

pytestmark = needs_policies


@pytest.fixture(scope="module")
def subjects(tmp_path_factory):
    folder = tmp_path_factory.mktemp("published")
    return {name: published(name, folder) for name in FILES}


@pytest.fixture
def search(subjects):
    def run(policy, plant=None):
        right = subjects[policy]
        wrong = right.contract if plant is None else plant(right.contract)
        subject = replace(right, contract=wrong, motion=right.motion_under(wrong))
        return search_trace(subject, Samples(subject, trace_of(policy)))

    return run


@pytest.mark.parametrize("policy", FILES)
def test_the_right_contract_is_clean(search, policy):
    assert search(policy).is_healthy


PLANTED = {
    "unitree": ("gains in another order", "default pose zero"),
    "waltz": ("order of all joints", "quaternion order"),
    "holosoma": ("25 Hz",),
    "berkeley": ("sign of a joint",),
    "playground": ("last action scaled",),
}


@pytest.mark.parametrize(("policy", "name"), [(policy, name) for policy, names in PLANTED.items() for name in names])
def test_a_planted_mistake_is_named_first(subjects, search, policy, name):
    right = subjects[policy]
    result = search(policy, plants_of(policy, right.description.joint_names, isaac_order(right.description))[name])
    assert alike(result.finding.contract, right.contract)


def test_a_mistake_that_a_readme_describes_is_named_first(subjects, search):
    result = search("waltz", term("motion_anchor_ori_b", layout="two_rows"))
    assert alike(result.finding.contract, subjects["waltz"].contract)
