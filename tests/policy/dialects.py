"""Contracts, any and all of them, and the contract.yaml of each."""

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as st

from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, TensorNames, Term
from humanoid_sim.policy.readers.own import encode

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
        source=draw(st.dictionaries(names, names, max_size=3)),
    )


def said(contract: PolicyContract) -> dict[str, Any]:
    """All that a contract says, as plain values, without where it says it from."""
    return json.loads(encode(contract))["contract"]


def as_contract_yaml(contract: PolicyContract) -> dict[str, Any]:
    """The document of a contract.yaml that gives every field."""
    document: dict[str, Any] = {}
    for field in fields(PolicyContract):
        value = getattr(contract, field.name)
        if field.name not in ("source", "observation", "phase", "tensors", "command_ranges"):
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
