"""The policy contract: its fields checked against each other, the grid of a height scan, live inputs."""

import numpy as np
import pytest
from rig import JOINTS, contract, state

from humanoid_sim.controllers.contract import HeightScan, PhaseRule, Term
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import Extern


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task_type": "dance"}, "task_type: is 'dance', expected one of tracking, piano, locomotion"),
        ({"joint_names": ("wrist", "elbow", "elbow")}, "joint_names: is elbow, .* none twice"),
        ({"action_joint_names": ("elbow", "neck")}, "action_joint_names: is neck, expected names of wrist, elbow, sho"),
        ({"joint_stiffness": [1.0, 2.0]}, r"joint_stiffness: has shape \(2,\), expected \(3,\)"),
        ({"joint_damping": [1.0, 2.0, np.nan]}, "joint_damping: is nan for shoulder"),
        ({"observation": ("joint_pos", "joint_pos")}, "observation: is joint_pos, .* none twice"),
        ({"policy_dt": 0.0}, "policy_dt: is 0.0, expected seconds > 0"),
        ({"effort_limit": [5.0, -1.0, 5.0]}, "effort_limit: is -1.0 for elbow"),
        ({"effort_limit": [5.0, -1.0, -2.0]}, "effort_limit: is -1.0 for elbow and 1 more, expected"),
        ({"position_clip": [[1.0, 0.0]]}, "position_clip: is"),
        ({"position_clip": "any"}, "position_clip: is 'any'"),
        ({"command_ranges": [[0, 1]]}, "command_ranges: is"),
        ({"observation": [Term("joint_pos", joints=("neck",))]}, "observation: term 'joint_pos': is neck"),
        (
            {"observation": [Term("joint_pos", history=2), Term("actions")], "history_layout": "per_step"},
            "history_layout: is per_step",
        ),
        ({"observation": ("target_keys_future",)}, r"lookahead_steps: is \(\)"),
    ],
)
def test_a_field_that_does_not_fit_is_named(changes, message):
    with pytest.raises(FieldError, match=rf"^PolicyContract\.{message}"):
        contract(**changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Term("joint_pos", history=0), "history: is 0"),
        (lambda: Term("joint_pos", scan=HeightScan()), "only a height_scan has one"),
        (lambda: Term("foot_contact", timeout=1.0), "a width declares one"),
        (lambda: Term("foot_contact", width=2, timeout=0.0), "expected seconds > 0"),
        (lambda: HeightScan(grid=(1.6,)), "expected two lengths"),
        (lambda: Term("left-hand 2", width=2), "expected a ROS 2 name"),
        (lambda: PhaseRule(1.0, offsets=[]), "offsets: is"),
    ],
)
def test_a_part_that_cannot_be_is_refused(make, message):
    with pytest.raises(FieldError, match=message):
        make()


@pytest.mark.parametrize(
    ("grid", "resolution", "x", "y"),
    [
        ((0.4, 0.2), 0.2, [-0.2, 0.0, 0.2], [-0.1, 0.1]),
        ((0.5, 0.0), 0.2, [-0.25, -0.05, 0.15], [0.0]),  # Isaac Lab's points too lie within the grid
        ((0.3, 0.7), 0.1, [-0.15, -0.05, 0.05, 0.15], np.arange(8) * 0.1 - 0.35),  # 0.7 / 0.1 is below 7
    ],
)
def test_points_of_a_grid(grid, resolution, x, y):
    scan = HeightScan(grid=grid, resolution=resolution)
    assert scan.points == pytest.approx(np.array([(each, other) for other in y for each in x]))
    assert scan.count == len(x) * len(y)


TWO = Term("height_scan", scan=HeightScan(grid=(0.1, 0.0)), scale=2.0, clip=(-1.0, 1.0))
FOOT = Term("foot_contact", width=2, scale=2.0)


def wired(*terms, extern):
    made = contract(task_type="locomotion", body_names=(), observation=(*terms, Term("joint_pos")))
    return PolicyWiring(JOINTS, made, no_reference(), extern)


def test_a_policy_has_one_scan_of_the_robots_width():
    again = Term("again", kind="height_scan", scan=TWO.scan, history=3)
    assert wired(TWO, again, extern={"height_scan": 2}).layout.width == 2 + 6 + 3
    with pytest.raises(FieldError, match="height_scan and other differ in width, timeout or scan"):
        wired(TWO, Term("other", kind="height_scan"), extern={"height_scan": 2})
    with pytest.raises(FieldError, match="is 2 wide, but the input has 187"):
        wired(TWO, extern={"height_scan": 187})
    with pytest.raises(FieldError, match="needs the live input 'height_scan'"):
        wired(TWO, extern={})


@pytest.mark.parametrize(
    ("term", "name"), [(TWO, "height_scan"), (FOOT, "foot_contact"), (Term("key_pressed", scale=2.0), "key_pressed")]
)
def test_a_live_input_that_is_missing_or_stale_stops_the_policy_and_is_never_zeros(term, name):
    wiring = wired(term, extern={name: 2})
    values = {name: Extern([0.3, 0.5], 1.0, timeout=0.5)}

    def observed(now, extern):
        given = state(now, extern=extern)
        observation, _ = wiring.observe(wiring.activate(given), given)
        return observation[:2].tolist(), wiring.observation_problem(observation)

    assert observed(1.5, values) == (pytest.approx([0.6, 1.0]), "")
    for now, extern in ((1.502, values), (1.0, {})):
        seen, problem = observed(now, extern)
        assert np.isnan(seen).all()
        assert problem.startswith(f"observation {name}[0] is nan")
        assert "has come, or the last one is too old" in problem


def test_topics_are_named_after_their_inputs():
    terms = (
        FOOT,
        Term("toe", width=1, timeout=np.inf),
        Term("keys", "key_pressed", width=12),
        Term("height_scan", timeout=0.1),
    )
    made = contract(task_type="locomotion", body_names=(), observation=terms)
    assert dict(made.live_topics) == {
        "foot_contact": ("/foot_contact", None),
        "toe": ("/toe", np.inf),
        "key_pressed": ("/piano/key_state", None),
        "height_scan": ("/height_scan", 0.1),
    }
