"""The policy contract: its fields, checked against each other."""

from dataclasses import fields

import numpy as np
import pytest
from rig import contract

from humanoid_sim.controllers.contract import FORMS, PolicyContract
from humanoid_sim.controllers.terms import Term
from humanoid_sim.errors import FieldError


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task_type": "dance"}, "task_type: is 'dance', expected one of tracking, piano, locomotion"),
        ({"task_type": None}, "task_type: is None"),
        ({"joint_names": ()}, "joint_names: is empty"),
        ({"joint_names": "wrist"}, "joint_names: is the string 'wrist'"),
        ({"joint_names": ("wrist", "elbow", "elbow")}, "joint_names: names elbow more than once"),
        ({"action_joint_names": ()}, "action_joint_names: is empty"),
        ({"action_joint_names": ("elbow", "neck")}, "action_joint_names: neck not in joint_names: wrist, elbow, shoul"),
        ({"action_joint_names": ("elbow", "elbow")}, "action_joint_names: names elbow more than once"),
        ({"joint_stiffness": [1.0, 2.0]}, r"joint_stiffness: has shape \(2,\), expected \(3,\)"),
        ({"joint_stiffness": [1.0, -2.0, 3.0]}, "joint_stiffness: is -2.0 for elbow, expected a finite number >= 0"),
        ({"joint_damping": [1.0, 2.0, np.nan]}, "joint_damping: is nan for shoulder"),
        ({"joint_damping": [-1.0, 2.0, 1.0]}, "joint_damping: is -1.0 for wrist"),
        ({"default_joint_pos": [0.0, np.inf, 0.0]}, "default_joint_pos: is inf for elbow, expected a finite number"),
        ({"default_joint_pos": [0.0]}, r"default_joint_pos: has shape \(1,\), expected \(3,\)"),
        ({"observation": ()}, "observation: is empty"),
        ({"observation": ("joint_pos", "joint_pos")}, "observation: names joint_pos more than once"),
        ({"action_scale": [0.5, 0.5, 0.5]}, r"action_scale: has shape \(3,\), expected \(2,\)"),
        ({"action_scale": np.nan}, "action_scale: is nan for elbow"),
        ({"policy_dt": 0.0}, "policy_dt: is 0.0, expected a finite number > 0"),
        ({"policy_dt": -0.02}, "policy_dt: is -0.02"),
        ({"policy_dt": np.nan}, "policy_dt: is nan"),
        ({"policy_dt": "0.02"}, "policy_dt: is '0.02'"),
        ({"command_names": "twist"}, "command_names: is the string 'twist'"),
        ({"command_names": None}, "command_names: is None"),
        ({"body_names": "hand"}, "body_names: is the string 'hand'"),
        ({"body_names": ("hand", "hand")}, "body_names: names hand more than once"),
        ({"body_names": (1,)}, "body_names: holds 1, expected names"),
        ({"lookahead_steps": (1, -1)}, r"lookahead_steps: is \(1, -1\), expected integers >= 0"),
        ({"lookahead_steps": (1.5,)}, r"lookahead_steps: is \(1.5,\), expected integers >= 0"),
        ({"lookahead_steps": (True,)}, r"lookahead_steps: is \(True,\), expected integers >= 0"),
        (
            {"effort_limit": [5.0, -1.0, 5.0]},
            r"effort_limit: is \[5.0, -1.0, 5.0\], expected a number > 0 for each of 3",
        ),
        (
            {"effort_limit": [5.0, 5.0]},
            r"effort_limit: is \[5.0, 5.0\], expected a number > 0 for each of 3 joints, or",
        ),
        ({"action_clip": 0.0}, "action_clip: is 0.0, expected a number > 0"),
        ({"action_offset": [0.0]}, r"action_offset: has shape \(1,\), expected \(2,\)"),
        (
            {"position_clip": [[1.0, 0.0]]},
            r"position_clip: is \[\[1.0, 0.0\]\], expected \[least, greatest\] for each of",
        ),
        ({"position_clip": [0.0, 1.0]}, r"position_clip: is \[0.0, 1.0\], expected \[least, greatest\] for each of"),
        ({"command_ranges": [[0, 1]]}, r"command_ranges: is \[\[0.0, 1.0\]\], expected \[least, greatest\] for vx"),
        ({"history_layout": "mixed"}, "history_layout: is 'mixed', expected one of per_term, per_step"),
        ({"reference_quaternion": "wzyx"}, "reference_quaternion: is 'wzyx', expected one of wxyz, xyzw"),
        (
            {"observation": [Term("joint_pos", joints=("neck",))]},
            "observation: term 'joint_pos' shows neck, not in joint",
        ),
        (
            {"observation": [Term("joint_pos", history=2), Term("actions")], "history_layout": "per_step"},
            r"history_layout: per_step needs one history for all terms, they have \[1, 2\]",
        ),
        ({"lookahead_steps": 3}, "lookahead_steps: is 3, expected integers >= 0"),
        ({"observation": ("target_keys_future",)}, "lookahead_steps: is empty, but the observation has target_k"),
    ],
)
def test_what_is_wrong_is_named(changes, message):
    with pytest.raises(FieldError, match=rf"^PolicyContract\.{message}"):
        contract(**changes)


def test_every_field_but_the_provenance_has_a_form():
    assert [*FORMS, "provenance"] == [field.name for field in fields(PolicyContract)]
    assert [name for name, form in FORMS.items() if form.is_required] == [
        "joint_names", "joint_stiffness", "joint_damping", "default_joint_pos", "observation", "action_scale",
        "policy_dt",
    ]  # fmt: skip
