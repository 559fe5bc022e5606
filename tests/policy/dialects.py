"""Contracts, any and all of them, and the contract.yaml of each."""

import json
from collections.abc import Mapping
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


pairs = st.tuples(numbers, numbers).map(lambda pair: tuple(sorted(pair)))
phases = st.builds(
    PhaseRule,
    period=st.floats(0.1, 10.0),
    offsets=st.lists(numbers, min_size=1, max_size=3),
    advance_first=st.booleans(),
    standing_threshold=st.floats(0.0, 1.0),
    standing_value=st.none() | numbers,
    standing_restarts=st.booleans(),
)


def terms(name: str, joints: tuple[str, ...], history: st.SearchStrategy[int]) -> st.SearchStrategy[Term]:
    return st.builds(
        Term,
        name=st.just(name),
        kind=st.sampled_from(["", "joint_pos", "live_input"]),
        scale=numbers | arrays(3),
        clip=st.none() | pairs,
        history=history,
        history_order=st.sampled_from(["oldest_first", "newest_first"]),
        frame=st.sampled_from(["body", "world"]),
        relative=st.sampled_from([None, True, False]),
        layout=st.sampled_from(["rows", "columns", "two_rows"]),
        inverse=st.booleans(),
        quaternion=st.sampled_from(["wxyz", "xyzw"]),
        form=st.sampled_from(["raw", "scaled"]),
        joints=st.none() | st.lists(st.sampled_from(joints), min_size=1, unique=True).map(tuple),
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
        position_clip=draw(st.none() | st.lists(pairs, min_size=m, max_size=m)),
        history_layout=layout,
        command_ranges=draw(st.none() | st.lists(pairs, min_size=3, max_size=3)),
        phase=draw(st.none() | phases),
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
    document = said(contract)
    for term in document["observation"]:
        for name in [name for name, value in term.items() if value is None]:
            del term[name]
    if document["command_ranges"] is not None:
        axes = ("lin_vel_x", "lin_vel_y", "ang_vel_z")
        document["command_ranges"] = dict(zip(axes, document["command_ranges"], strict=True))
    return document


def through_yaml(document: Mapping[str, Any]) -> str:
    return yaml.dump(dict(document), Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True)
