"""Contracts, any and all of them, and how each dialect writes one down."""

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as st
from models import contract_of

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, TensorNames
from humanoid_sim.controllers.terms import Term
from humanoid_sim.policy.contract_json import encode

ROBOT = ("hip", "knee", "ankle", "waist", "elbow")
PROPRIOCEPTION = (
    "base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos_rel", "joint_vel_rel", "last_action",
)  # fmt: skip
WIDTHS = {"base_ang_vel": 3, "projected_gravity": 3, "velocity_commands": 3}

numbers = st.floats(-100.0, 100.0)
gains = st.floats(0.0, 500.0)
names = st.text(st.characters(codec="utf-8", exclude_characters=",", exclude_categories=["C"]), min_size=1).filter(
    lambda text: text == text.strip()
)


def arrays(size: int, elements: st.SearchStrategy[float] = numbers) -> st.SearchStrategy[Any]:
    return st.lists(elements, min_size=size, max_size=size).map(np.array)


@st.composite
def pairs(draw: st.DrawFn) -> tuple[float, float]:
    low, high = sorted([draw(numbers), draw(numbers)])
    return low, high


@st.composite
def phases(draw: st.DrawFn) -> PhaseRule:
    return PhaseRule(
        period=draw(st.floats(0.1, 10.0)),
        offsets=draw(arrays(draw(st.integers(1, 3)))),
        advance_first=draw(st.booleans()),
        standing_threshold=draw(st.floats(0.0, 1.0)),
        standing_value=draw(st.none() | numbers),
        standing_restarts=draw(st.booleans()),
    )


@st.composite
def terms(draw: st.DrawFn, name: str, joints: tuple[str, ...], history: st.SearchStrategy[int]) -> Term:
    return Term(
        name=name,
        kind=draw(st.just("") | st.sampled_from(["joint_pos", "live_input"])),
        scale=draw(numbers | arrays(3)),
        clip=draw(st.none() | pairs()),
        history=draw(history),
        history_order=draw(st.sampled_from(["oldest_first", "newest_first"])),
        frame=draw(st.sampled_from(["body", "world"])),
        relative=draw(st.sampled_from([None, True, False])),
        layout=draw(st.sampled_from(["rows", "columns", "two_rows"])),
        inverse=draw(st.booleans()),
        quaternion=draw(st.sampled_from(["wxyz", "xyzw"])),
        form=draw(st.sampled_from(["raw", "scaled"])),
        joints=draw(st.none() | st.lists(st.sampled_from(joints), min_size=1, unique=True).map(tuple)),
    )


@st.composite
def contracts(draw: st.DrawFn) -> PolicyContract:
    """Anything that a contract can say."""
    joints = tuple(draw(st.lists(names, min_size=1, max_size=5, unique=True)))
    driven = tuple(draw(st.lists(st.sampled_from(joints), min_size=1, unique=True)))
    layout = draw(st.sampled_from(["per_term", "per_step"]))
    history = st.just(draw(st.integers(1, 5))) if layout == "per_step" else st.integers(1, 5)
    observed = draw(st.lists(names, min_size=1, max_size=4, unique=True))
    n, m = len(joints), len(driven)
    return PolicyContract(
        task_type=draw(st.sampled_from(["tracking", "piano", "locomotion"])),
        joint_names=joints,
        action_joint_names=driven,
        joint_stiffness=draw(arrays(n, gains)),
        joint_damping=draw(arrays(n, gains)),
        default_joint_pos=draw(arrays(n)),
        observation=[draw(terms(name, joints, history)) for name in observed],
        command_names=tuple(draw(st.lists(names, max_size=2, unique=True))),
        action_scale=draw(arrays(m)),
        policy_dt=draw(st.floats(0.001, 1.0)),
        body_names=tuple(draw(st.lists(names, max_size=3, unique=True))),
        dataset_repo_id=draw(st.text(st.characters(codec="utf-8", exclude_categories=["C"])).map(str.strip)),
        lookahead_steps=tuple(draw(st.lists(st.integers(0, 1000), max_size=3))),
        action_offset=draw(arrays(m)),
        action_clip=draw(st.just(float("inf")) | st.floats(0.1, 100.0)),
        position_clip=draw(st.none() | st.lists(pairs(), min_size=m, max_size=m)),
        history_layout=layout,
        command_ranges=draw(st.none() | st.lists(pairs(), min_size=3, max_size=3)),
        phase=draw(st.none() | phases()),
        anchor_body=draw(st.just("") | names),
        align_reference=draw(st.booleans()),
        reference_quaternion=draw(st.sampled_from(["wxyz", "xyzw"])),
        tensors=TensorNames(*draw(st.tuples(*[st.just("") | names] * 3))),
        provenance=draw(st.dictionaries(names, names, max_size=3)),
    )


@st.composite
def walkers(draw: st.DrawFn, robot: tuple[str, ...] = ROBOT) -> PolicyContract:
    """A policy that walks on proprioception, of the joints in any order: what all dialects can say."""
    joints = tuple(draw(st.permutations(robot)))
    n = len(joints)
    history = draw(st.integers(1, 4))
    widths = {name: WIDTHS.get(name, n) for name in PROPRIOCEPTION}
    observation = [
        Term(name, scale=draw(arrays(widths[name])), clip=draw(st.none() | pairs()), history=history)
        for name in draw(st.permutations(PROPRIOCEPTION))
    ]
    return contract_of(
        joints,
        joint_stiffness=draw(arrays(n, gains)),
        joint_damping=draw(arrays(n, gains)),
        default_joint_pos=draw(arrays(n)),
        observation=observation,
        command_names=("base_velocity",),
        action_scale=draw(arrays(n)),
        policy_dt=draw(st.sampled_from([0.02, 0.04, 0.01])),
        action_offset=draw(arrays(n)),
        position_clip=draw(st.none() | st.lists(pairs(), min_size=n, max_size=n)),
        history_layout=draw(st.sampled_from(["per_term", "per_step"])),
        command_ranges=draw(st.lists(pairs(), min_size=3, max_size=3)),
    )


def a_walker() -> PolicyContract:
    """One of them."""
    return contract_of(
        ("knee", "hip", "elbow", "waist", "ankle"),
        joint_stiffness=[1.0, 2.0, 3.0, 4.0, 5.0],
        joint_damping=[0.1, 0.2, 0.3, 0.4, 0.5],
        default_joint_pos=[0.3, -0.1, 0.5, 0.0, -0.2],
        observation=("base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos_rel", "last_action"),
        command_names=("base_velocity",),
        action_scale=0.25,
        command_ranges=[[-1.0, 1.0], [-0.5, 0.5], [-1.0, 1.0]],
    )


def said(contract: PolicyContract, *left_out: str) -> dict[str, Any]:
    """All that a contract says, as plain values, without where it says it from."""
    document = json.loads(encode(contract))
    for name in ("provenance", *left_out):
        del document[name]
    return document


def as_mjlab(contract: PolicyContract, digits: str = "") -> dict[str, str]:
    """The metadata of mjlab 1.6; with the digits ".3f" exactly as it writes them, and by default with all of them."""

    def csv(values: Any, separator: str = ",") -> str:
        numbers = (value if isinstance(value, str) else format(float(value), digits) for value in values)
        return separator.join(numbers)

    clips = [(-np.inf, np.inf) if term.clip is None else term.clip for term in contract.terms]
    followed = {"anchor_body_name": contract.anchor_body, "body_names": csv(contract.body_names)}
    return {
        "run_path": "local",
        "joint_names": csv(contract.joint_names),
        "joint_stiffness": csv(contract.joint_stiffness),
        "joint_damping": csv(contract.joint_damping),
        "default_joint_pos": csv(contract.default_joint_pos),
        "command_names": csv(contract.command_names),
        "observation_names": csv(contract.observation_names),
        "observation_terms_scale": csv(csv(np.atleast_1d(term.scale), ";") for term in contract.terms),
        "observation_terms_flatten_history_dim": csv(1 for _ in contract.terms),
        "observation_terms_history_length": csv(0 if term.history == 1 else term.history for term in contract.terms),
        "observation_terms_clip": csv(csv(clip, ";") for clip in clips),
        "action_scale": csv(contract.action_scale),
        **(followed if contract.task_type == "tracking" else {}),
    }


def as_holosoma(contract: PolicyContract) -> dict[str, str]:
    assert contract.command_ranges is not None
    ranges = contract.command_ranges.tolist()
    document = {
        "dof_names": list(contract.joint_names),
        "kp": contract.joint_stiffness.tolist(),
        "kd": contract.joint_damping.tolist(),
        "command_ranges": dict(zip(("lin_vel_x", "lin_vel_y", "ang_vel_yaw"), ranges, strict=True)),
        "action_scale": contract.action_scale.tolist(),
    }
    return {key: json.dumps(value) for key, value in document.items()}


def as_deploy(contract: PolicyContract, robot: tuple[str, ...] = ROBOT) -> dict[str, Any]:
    """The document of a deploy.yaml: gains in the robot's order, everything else in the policy's."""
    order = [contract.joint_names.index(joint) for joint in robot]
    assert contract.command_ranges is not None
    assert contract.action_offset is not None
    ranges = contract.command_ranges.tolist()
    observations: dict[str, Any] = {
        term.name: {
            "params": {},
            "clip": None if term.clip is None else list(term.clip),
            "scale": np.asarray(term.scale).tolist(),
            "history_length": term.history,
        }
        for term in contract.terms
    }
    if contract.history_layout == "per_step":
        observations = {"use_gym_history": True, **observations}
    return {
        "joint_ids_map": [robot.index(joint) for joint in contract.joint_names],
        "step_dt": contract.policy_dt,
        "stiffness": contract.joint_stiffness[order].tolist(),
        "damping": contract.joint_damping[order].tolist(),
        "default_joint_pos": contract.default_joint_pos.tolist(),
        "commands": {
            "base_velocity": {
                "ranges": dict(zip(("lin_vel_x", "lin_vel_y", "ang_vel_z"), ranges, strict=True)) | {"heading": None}
            }
        },
        "actions": {
            "JointPositionAction": {
                "clip": None if contract.position_clip is None else contract.position_clip.tolist(),
                "joint_names": [".*"],
                "scale": contract.action_scale.tolist(),
                "offset": contract.action_offset.tolist(),
                "joint_ids": None,
            }
        },
        "observations": observations,
    }


def as_contract_yaml(contract: PolicyContract) -> dict[str, Any]:
    """The document of a contract.yaml that gives every field."""
    document: dict[str, Any] = {}
    for field in fields(PolicyContract):
        value = getattr(contract, field.name)
        if field.name not in ("provenance", "observation", "phase", "tensors", "command_ranges"):
            document[field.name] = _plain(value)
    document["observation"] = [_struct(term) for term in contract.terms]
    document["tensors"] = _struct(contract.tensors)
    document["phase"] = None if contract.phase is None else _struct(contract.phase)
    ranges = contract.command_ranges
    axes = ("lin_vel_x", "lin_vel_y", "ang_vel_z")
    document["command_ranges"] = None if ranges is None else dict(zip(axes, ranges.tolist(), strict=True))
    return document


def _struct(value: Any) -> dict[str, Any]:
    plain = {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    return {name: item for name, item in plain.items() if item is not None or name == "standing_value"}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value


def through_yaml(document: Mapping[str, Any]) -> str:
    return yaml.dump(dict(document), Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True)
