"""Policies, motions and robots that fit each other or not, and a recording's header as the same stack again."""

import json
from dataclasses import fields, replace
from functools import cache

import models
import numpy as np
import pytest

from humanoid_sim.controllers.base import RL_POLICY
from humanoid_sim.errors import InputError
from humanoid_sim.mit import EXTERN_WIDTHS
from humanoid_sim.policy.checkpoint import zero_policy
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor, rebuild_supervisor, run_header
from humanoid_sim.testing.properties import fingerprint

LITE = load_robot("lite")


def lite_contract(**changes):
    """A tracking policy of one hand for the Lite; the observation is 3 + 6 + 14 = 23 wide."""
    joints = LITE.joint_names
    values = {
        "task_type": "tracking",
        "joint_names": joints,
        "action_joint_names": joints,
        "joint_stiffness": LITE.stiffness,
        "joint_damping": LITE.damping,
        "default_joint_pos": np.zeros(14),
        "observation": ("motion_body_pos_b", "motion_body_ori_b", "joint_pos"),
        "action_scale": 0.5,
        "body_names": ("left_hand",),
    }
    return models.contract(**{**values, **changes})


def motion(width=9, **changes):
    values = {"body_names": ("left_hand",), "policy_dt": 0.02, "task_type": "tracking"}
    return Motion(np.ones((5, width), dtype=np.float32), **{**values, **changes})


def test_a_piano_policy_observes_as_many_keys_as_it_has_goals():
    contract = lite_contract(
        task_type="piano",
        observation=("target_keys", "target_keys_future", "key_pressed", "progress"),
        lookahead_steps=(1, 2),
        body_names=(),
    )
    loaded = load_policy(contract, zero_policy(14), motion(88, body_names=(), task_type="piano"))
    assert dict(loaded.extern) == {**EXTERN_WIDTHS, "key_pressed": 88}
    assert loaded.layout.width == 88 + 2 * 88 + 88 + 1
    assert dict(loaded.live_inputs({"base_linear_velocity": 3})) == {"key_pressed": 88}
    assert dict(loaded.live_inputs({"key_pressed": 88})) == {}, "a simulated piano's are known"


@pytest.mark.parametrize(
    ("contract", "followed", "width", "expected"),
    [
        (lite_contract(), None, None, "p.onnx: task_type tracking follows a motion"),
        (lite_contract(), motion(body_names=("left_foot",)), None, "p.onnx: motion: describes "),
        (lite_contract(), motion(policy_dt=0.021), None, "p.onnx: motion: has a frame every 0.021 s"),
        (lite_contract(), motion(), 24, "p.onnx: observation: is 23 wide"),
    ],
)
def test_what_does_not_fit_is_one_line_with_the_file(contract, followed, width, expected):
    with pytest.raises(InputError) as caught:
        load_policy(contract, zero_policy(14), followed, width, source="p.onnx")
    assert str(caught.value).startswith(expected)
    assert "\n" not in str(caught.value)


@cache
def header():
    loaded = load_policy(lite_contract(), zero_policy(14), motion())
    options = {"remote": True}
    head = run_header(LITE, 0.005, loaded, settings={"policy": "p.onnx"}, **options)
    return head, build_supervisor(LITE, 0.005, loaded, **options)


def test_a_recordings_header_gives_the_same_stack_again():
    head, first = header()
    again = rebuild_supervisor(head, zero_policy(14))
    assert again.joints == first.joints
    assert fingerprint(again.guards) == fingerprint(first.guards)
    assert set(again.controllers) == set(first.controllers)
    for name, controller in first.controllers.items():
        for field in fields(controller):
            before, after = getattr(controller, field.name), getattr(again.controllers[name], field.name)
            if isinstance(before, np.ndarray | str | int | float | tuple):
                assert fingerprint(before) == fingerprint(after), (name, field.name)
    policy = again.controllers[RL_POLICY]
    assert policy.contract.joint_stiffness.tobytes() == LITE.stiffness.tobytes()
    assert fingerprint(policy.reference) == fingerprint(first.controllers[RL_POLICY].reference)
    settings = json.loads(head.documents["settings"])
    assert settings["policy"] == "p.onnx"
    assert settings["versions"]["numpy"] == np.__version__


@pytest.mark.parametrize(("name", "text"), [("robot", "{"), ("controllers", "[]"), ("contract", "")])
def test_a_header_whose_documents_are_damaged_is_one_line(name, text):
    head, _ = header()
    with pytest.raises(InputError) as caught:
        rebuild_supervisor(replace(head, documents={**head.documents, name: text}), zero_policy(14))
    assert "\n" not in str(caught.value)


def test_a_run_without_a_policy_is_rebuilt_without():
    again = rebuild_supervisor(run_header(LITE, 0.005, None, settings={}), zero_policy(0))
    assert RL_POLICY not in again.controllers
