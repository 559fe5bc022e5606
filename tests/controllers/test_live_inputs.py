"""Live inputs: declared by a term's width, resolved like any term, and never zeros in silence."""

import numpy as np
import pytest
from rig import JOINTS, KNOWN, contract, state

from humanoid_sim.controllers.live_inputs import LiveInputs
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import Extern, MITState
from humanoid_sim.policy.contract_json import decode, encode

FOOT = Term("foot_contact", width=2, scale=2.0)


def live_contract(*terms):
    return contract(task_type="locomotion", body_names=(), observation=(*(terms or (FOOT,)), Term("joint_pos")))


def wiring(**changes):
    declared = live_contract()
    return PolicyWiring(JOINTS, declared, no_reference(), changes.get("extern", declared.live_inputs))


def observed(given):
    resolved = wiring()
    observation, _ = resolved.observe(resolved.activate(given), given)
    return [float(value) for value in observation[:2]]


def test_declared_values_are_observed_with_the_terms_scale():
    fed = LiveInputs(live_contract(), {"foot_contact": lambda given: given.joint_position[..., :2]})
    heard = fed.heard(state(time=3.0, position=KNOWN))
    assert heard.extern["foot_contact"].value.tolist() == [0.4, 0.5]
    assert heard.extern["foot_contact"].arrival_time == 3.0
    assert observed(heard) == pytest.approx([0.8, 1.0])

    assert decode(encode(live_contract()), "here").terms[0].width == 2
    assert encode(live_contract()).count('"width"') == 1, "no other term has one in a written contract"


def test_one_value_is_every_robots():
    zeros = np.zeros((3, 3))
    batch = MITState(0.0, zeros, zeros, zeros, zeros, np.zeros((3, 4)), zeros, zeros)
    heard = LiveInputs(live_contract(), {"foot_contact": lambda _: [1.0, 0.0]}).heard(batch)
    assert heard.extern["foot_contact"].value.tolist() == [[1.0, 0.0]] * 3


def test_one_that_is_missing_or_too_old_is_not_a_number():
    assert np.isnan(observed(state())).all()
    old = {"foot_contact": Extern(np.ones(2), arrival_time=1.0, timeout=0.5)}
    assert np.isnan(observed(state(time=2.0, extern=old))).all()
    assert observed(state(time=1.4, extern=old)) == [2.0, 2.0]
    problem = wiring().observation_problem(np.array([np.nan, np.nan, 0.0, 0.0, 0.0], dtype=np.float32))
    assert problem == (
        "observation foot_contact[0] is nan, expected a finite number: no value has come, or the last one is too old"
    )
    problem = wiring().observation_problem(np.array([np.inf, 0.0, 0.0, 0.0, 0.0], dtype=np.float32))
    assert problem == "observation foot_contact[0] is inf, expected a finite number"


def test_a_policy_whose_live_input_nothing_feeds_is_refused():
    with pytest.raises(FieldError) as caught:
        wiring(extern={})
    assert str(caught.value) == (
        "observation term 'foot_contact' needs the live input 'foot_contact' of width 2 "
        "(fed through `live` from Python), and there is none"
    )


@pytest.mark.parametrize(
    ("name", "width", "problem"),
    [
        ("foot_contact", 0, "width is 0, expected a whole number >= 1"),
        ("foot_contact", True, "width is True, expected a whole number >= 1"),
        ("foot_contact", 2.0, "width is 2.0, expected a whole number >= 1"),
        ("dof_pos", 3, "width is 3, expected none: only a live input has one of its own"),
        ("command", 3, "width is 3, expected none: only a live input has one of its own"),
        ("anchor_pose", 7, "width is 7, expected none: only a live input has one of its own"),
        ("base_linear_velocity_at_imu", 3, "width is 3, expected none: only a live input has one of its own"),
    ],
)
def test_widths_that_are_refused(name, width, problem):
    with pytest.raises(FieldError) as caught:
        Term(name, width=width)
    assert str(caught.value) == f"observation term '{name}': {problem}"


def test_topics_are_named_after_their_inputs_unless_the_contract_says_otherwise():
    fed = live_contract(
        FOOT,
        Term("left-hand 2", width=1, timeout=np.inf),
        Term("keys", "key_pressed", width=12),
        Term("height_scan", topic="/elevation", timeout=0.1),
    )
    assert dict(fed.live_topics) == {
        "foot_contact": ("/foot_contact", None),
        "left-hand 2": ("/left_hand_2", np.inf),
        "key_pressed": ("/piano/key_state", None),
        "height_scan": ("/elevation", 0.1),
    }
    assert dict(fed.live_timeouts) == {"left-hand 2": np.inf, "height_scan": 0.1}
    assert decode(encode(fed), "here").live_topics == fed.live_topics
    observed = PolicyWiring(JOINTS, fed, no_reference(), fed.sent_inputs).layout
    assert [term.width for term in observed.terms] == [2, 1, 12, 187, 3]
