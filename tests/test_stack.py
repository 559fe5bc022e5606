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
from humanoid_sim.testing import fingerprint

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


def refusal(contract, followed, width=None):
    with pytest.raises(InputError) as caught:
        load_policy(contract, zero_policy(14), followed, width, source="p.onnx", motion_source="m.mcap")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_policy_and_its_motion_fit():
    loaded = load_policy(lite_contract(), zero_policy(14), motion(), 23)
    assert loaded.layout.width == 23
    assert loaded.reference.frame_count == 5
    assert dict(loaded.extern) == dict(EXTERN_WIDTHS)


def test_a_piano_policy_hears_as_many_keys_as_it_has_goals():
    contract = lite_contract(
        task_type="piano",
        observation=("target_keys", "target_keys_future", "key_pressed", "progress"),
        lookahead_steps=(1, 2),
        body_names=(),
    )
    loaded = load_policy(contract, zero_policy(14), motion(88, body_names=(), task_type="piano"))
    assert dict(loaded.extern) == {**EXTERN_WIDTHS, "key_pressed": 88}
    assert loaded.layout.width == 88 + 2 * 88 + 88 + 1
    assert dict(loaded.taken({"base_linear_velocity": 3})) == {"key_pressed": 88}
    assert dict(loaded.taken({"key_pressed": 88})) == {}, "a simulated piano's are known"


@pytest.mark.parametrize(
    ("contract", "followed", "width", "expected"),
    [
        (lite_contract(), None, None, "p.onnx: task_type tracking follows a motion, and none is given: use --motion"),
        (lite_contract(), motion(task_type="piano", body_names=()), None, "m.mcap: is a motion for task_type piano; "),
        (lite_contract(), motion(body_names=("left_foot",)), None, "m.mcap: describes the bodies left_foot; p.onnx "),
        (
            lite_contract(),
            motion(policy_dt=0.021),
            None,
            "m.mcap: has a frame every 0.021 s, p.onnx a step every 0.02 ",
        ),
        (
            lite_contract(),
            motion(18, body_names=(), task_type=""),
            None,
            "p.onnx: motion: frames are 18 wide, expected 9, 9 for each of the policy's 1 bodies (left_hand)",
        ),
        (
            lite_contract(),
            motion(),
            24,
            "p.onnx: its terms are 23 wide (motion_body_pos_b 3 + motion_body_ori_b 6 + joint_pos 14), its model's "
            "input is 24",
        ),
        (lite_contract(observation=("mood",)), motion(), None, "p.onnx: unknown observation term 'mood'; known: "),
        (
            lite_contract(task_type="locomotion", observation=("motion_body_pos_b",)),
            None,
            None,
            "p.onnx: observation term 'motion_body_pos_b' needs a tracking motion, and there is none",
        ),
    ],
)
def test_what_does_not_fit_is_one_line_with_the_file(contract, followed, width, expected):
    assert refusal(contract, followed, width).startswith(expected)


@pytest.mark.parametrize(
    ("robot", "contract", "period", "expected"),
    [
        ("lite_neck", lite_contract(), 0.005, "policy on robot 'lite_neck': joint_names of the policy do not match "),
        ("lite", lite_contract(), 0.003, "policy on robot 'lite': "),
    ],
)
def test_a_policy_that_does_not_fit_the_robot(robot, contract, period, expected):
    loaded = load_policy(contract, zero_policy(14), motion())
    with pytest.raises(InputError, match=expected.replace("(", r"\(")):
        build_supervisor(load_robot(robot), period, loaded)


@cache
def tracker():
    return load_policy(lite_contract(), zero_policy(14), motion())


@cache
def header(loaded, *, remote=False):
    followed = motion() if loaded else None
    return run_header(LITE, 0.005, loaded, followed, remote=remote, settings={"policy": "p.onnx"})


def test_a_recordings_header_gives_the_same_stack_again():
    loaded = tracker()
    head = header(loaded, remote=True)
    again = rebuild_supervisor(head, zero_policy(14))
    first = build_supervisor(LITE, 0.005, loaded, remote=True)
    assert again.joints == first.joints
    assert set(again.controllers) == set(first.controllers)
    for name, controller in first.controllers.items():
        for field in fields(controller):
            before, after = getattr(controller, field.name), getattr(again.controllers[name], field.name)
            if isinstance(before, np.ndarray):
                assert before.tobytes() == after.tobytes(), (name, field.name)
            elif isinstance(before, str | int | float | tuple):
                assert before == after, (name, field.name)
    policy = again.controllers[RL_POLICY]
    assert policy.contract.joint_stiffness.tobytes() == loaded.contract.joint_stiffness.tobytes()
    for name, table in loaded.reference.terms.items():
        assert policy.reference.terms[name].tobytes() == table.tobytes()
    settings = json.loads(head.documents["settings"])
    assert set(settings) == {"policy", "definitions", "versions", "platform"}
    assert set(settings["definitions"]) == {"fall", "loss", "errors"}
    assert settings["policy"] == "p.onnx"
    assert settings["versions"]["numpy"] == np.__version__


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"remote": {}}x', "null"])
@pytest.mark.parametrize("name", ["robot", "controllers", "contract"])
def test_a_header_whose_documents_are_damaged_is_one_line(name, text):
    head = header(tracker())
    with pytest.raises(InputError) as caught:
        rebuild_supervisor(replace(head, documents={**head.documents, name: text}), zero_policy(14))
    assert "\n" not in str(caught.value)


def test_a_policy_that_needs_an_estimate_is_refused_where_there_is_none():
    contract = lite_contract(task_type="locomotion", observation=("base_lin_vel", "joint_pos"), body_names=())
    loaded = load_policy(contract, zero_policy(14), None)
    build_supervisor(load_robot("lite"), 0.005, loaded)
    with pytest.raises(InputError, match=r"^policy on robot 'lite': observation term 'base_lin_vel' needs the robot's"):
        build_supervisor(load_robot("lite"), 0.005, loaded, live={})


def test_a_recorded_run_is_rebuilt_with_its_guards():
    head = header(None)
    again = rebuild_supervisor(head, zero_policy(0))
    first = build_supervisor(LITE, 0.005, None)
    assert fingerprint(again.guards) == fingerprint(first.guards)
    assert first.guards is not None


def test_a_header_says_where_remote_required_a_producer_and_those_before_it_say_nothing():
    for needed in (False, True):
        head = run_header(LITE, 0.005, None, settings={}, remote=True, needs_producer=needed)
        assert ("needs_producer" in json.loads(head.documents["controllers"])) is needed
        assert rebuild_supervisor(head, zero_policy(0)).needs_producer is needed
