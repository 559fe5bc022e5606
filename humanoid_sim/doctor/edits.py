"""Single edits of a contract: what usually is wrong about one, put right, one change at a time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any, get_args, get_type_hints

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract, Term
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import BASE, IMU, FloatArray
from humanoid_sim.names import mirrored_pairs
from humanoid_sim.policy.findings import shown
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.readers.own import flattened, plain
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import breadth_first, build_model, joints_of

_BENT = {"hip_?pitch|HFE": -1.0, "knee|KFE": 2.0, "ankle_?pitch|FFE": -1.0}
"""Joints that bend where a humanoid stands with bent knees, and by how much, in shares of the shank's lean."""
_LEANS = (0.15, 0.3, -0.15, -0.3)  # rad

Orders = Mapping[str, tuple[str, ...]]
"""Orders that all joints of the policy may be in, by what they are called."""
Changes = Iterator[tuple[str, str, dict[str, Any]]]
"""Family, what is so in the edited contract, and the fields that change. Of equal edits the first counts."""
DOUBT: Mapping[str, float] = {"two joints": 0.1, "rate": 0.15, "joint sign": 0.03, "scale": 0.1, "gait clock": 0.1}
"""Share of its own errors by which an edit has to do better, by family: few contracts are wrong in this way."""


@dataclass(frozen=True, slots=True, eq=False)
class Edit:
    """One change to a contract that may put it right."""

    name: str  # what is so in the edited contract, to compare with the training configuration
    family: str
    contract: PolicyContract


def single_edits(
    contract: PolicyContract, robot: RobotDescription, motion: Motion | None = None, *, all_pairs: bool = False
) -> tuple[Edit, ...]:
    """Return every edit that fits the contract and changes it, no edited contract twice.

    With `all_pairs` any two joints are swapped, not only neighbours in the list or on the robot, and mirror images.
    """
    known = {
        "the robot's": robot.joint_names,
        "breadth-first (Isaac)": isaac_order(robot),
        "alphabetical": tuple(sorted(contract.joint_names)),
    }
    orders = {title: order for title, order in known.items() if sorted(order) == sorted(contract.joint_names)}
    found, unlike = dict[str, Edit](), asymmetry(contract)
    for family, name, fields in (
        *_joint_changes(contract, robot, orders, all_pairs=all_pairs),
        *_observation_changes(contract, motion),
        *_action_changes(contract, robot, orders),
        *_sign_changes(contract),
    ):
        try:
            edited = replace(contract, **fields)
        except FieldError:  # the change does not fit this contract
            continue
        if family != "gains" or asymmetry(edited) <= unlike:  # robots are alike on both sides
            found.setdefault(str(wiring_values(edited)), Edit(name, family, edited))
    found.pop(str(wiring_values(contract)), None)
    return tuple(found.values())


def isaac_order(robot: RobotDescription) -> tuple[str, ...]:
    """Return the robot's joints level by level through the kinematic tree."""
    model = build_model(robot, scene=False)
    return joints_of(model, breadth_first(model), robot.joint_names)


def wiring_values(contract: PolicyContract) -> dict[str, Any]:
    """Return a contract as plain values, by field, `phase.PART`, `tensors.PART` or `observation.TERM.OPTION`."""
    values = dict(flattened(plain(contract), "contract"))
    for term in contract.terms:
        if "relative" in contract.kind(term).conventions:  # none stands for the usual one
            values[f"observation.{term.name}.relative"] = contract.kind(term).is_relative(term)
    return values


def asymmetry(contract: PolicyContract) -> int:
    """Count the pairs of joints, left and right, whose gains, or magnitudes of scale and pose, differ."""
    scale = dict(zip(contract.action_joint_names, contract.action_scale, strict=True))
    scales = np.array([scale.get(name, 0.0) for name in contract.joint_names])
    rows = np.abs([contract.joint_stiffness, contract.joint_damping, contract.default_joint_pos, scales]).T
    values = dict(zip(contract.joint_names, rows, strict=True))
    pairs = mirrored_pairs(contract.joint_names)
    return sum(not np.allclose(values[left], values[right], rtol=1e-3) for left, right in pairs)


# --- joints ---


def _joint_changes(contract: PolicyContract, robot: RobotDescription, orders: Orders, *, all_pairs: bool) -> Changes:
    for title, order in orders.items():
        fields = _reordered(contract, order)
        yield "joint order", f"joint_names is in {title} order", _relabelled(contract, order)
        yield "joint order", f"the network has its joints, and their values, in {title} order", fields
    names = contract.joint_names
    near = {*pairwise(names), *pairwise(robot.joint_names), *mirrored_pairs(names)}
    for one, other in combinations(names, 2):
        if all_pairs or (one, other) in near or (other, one) in near:
            swap = {one: other, other: one}
            order = tuple(swap.get(name, name) for name in names)
            yield "two joints", f"{one} and {other} are in each other's places", _relabelled(contract, order)


def _relabelled(contract: PolicyContract, order: tuple[str, ...]) -> dict[str, Any]:
    """Give the joints, place by place, the names of `order`; all values stay in place."""
    names = dict(zip(contract.joint_names, order, strict=True))
    driven = tuple(names[name] for name in contract.action_joint_names)
    terms = [
        term if term.joints is None else replace(term, joints=tuple(names[joint] for joint in term.joints))
        for term in contract.terms
    ]
    return {"observation": terms, "joint_names": order, "action_joint_names": driven}


def _reordered(contract: PolicyContract, order: tuple[str, ...]) -> dict[str, Any]:
    """Sort the joints, and all values that belong to them, into `order`."""
    driven = tuple(name for name in order if name in contract.action_joint_names)
    joints, actions = _places(order, contract.joint_names), _places(driven, contract.action_joint_names)
    places = dict.fromkeys(("joint_stiffness", "joint_damping", "default_joint_pos", "effort_limit"), joints)
    places |= dict.fromkeys(("action_scale", "action_offset", "position_clip"), actions)
    values = {name: getattr(contract, name) for name in places}
    moved = {name: value[places[name]] for name, value in values.items() if isinstance(value, np.ndarray)}
    return {**moved, "joint_names": order, "action_joint_names": driven}


def _places(joints: tuple[str, ...], order: tuple[str, ...]) -> Any:
    return joint_indices(joints, tuple(name for name in order if name in joints), "joints")


def _sign_changes(contract: PolicyContract) -> Changes:
    """Turn each joint round in all that the policy sees of it and does with it."""
    for name in contract.joint_names:

        def turned(joints: tuple[str, ...], name: str = name) -> FloatArray:
            return np.where(np.array(joints) == name, -1.0, 1.0)

        terms = [
            # The reference, and the network's own output, are in the policy's directions already.
            replace(term, scale=term.scale * turned(value_names(term, contract)))
            if contract.kind(term).reads.startswith("joint_") or term.form == "scaled"
            else term
            for term in contract.terms
        ]
        of_action = turned(contract.action_joint_names)
        fields = {
            "observation": terms,
            "action_scale": contract.action_scale * of_action,
            "default_joint_pos": contract.default_joint_pos * turned(contract.joint_names) + 0.0,  # -0 is 0
            "action_offset": np.asarray(contract.action_offset) * of_action + 0.0,
        }
        yield "joint sign", f"{name} turns the other way in the policy than on the robot", fields


# --- observation ---


def _with_term(contract: PolicyContract, term: Term, **options: Any) -> dict[str, Any]:
    """Return the field of the terms with options of one of them set."""
    return {"observation": [replace(item, **options) if item.name == term.name else item for item in contract.terms]}


def _observation_changes(contract: PolicyContract, motion: Motion | None) -> Changes:
    terms = contract.terms
    by_name = sorted(terms, key=lambda term: term.name)
    yield "term order", "the terms are in alphabetical order", {"observation": by_name}
    for i, (one, other) in enumerate(pairwise(terms)):
        swapped = [*terms[:i], other, one, *terms[i + 2 :]]
        yield "term order", f"{other.name} comes before {one.name}", {"observation": swapped}
    for term in terms:
        for option, value in _conventions(contract, term):
            title = f"{option} of {term.name} is {shown(value)}"
            yield "convention", title, _with_term(contract, term, **{option: value})
    if motion is not None and motion.layout == "joints_bodies_w" and contract.requires("anchor_body"):
        for body in motion.body_names:
            yield "reference", f"the anchor body is {body}", {"anchor_body": body}
        align = not contract.align_reference
        title = f"the reference is {'' if align else 'not '}turned to the robot's heading"
        yield "reference", title, {"align_reference": align}
        for order in ("xyzw", "wxyz"):
            yield "reference", f"the motion's quaternions are ordered {order}", {"reference_quaternion": order}
    phase = contract.phase
    if phase is not None and contract.requires("phase"):
        other_foot, ahead = phase.offsets[::-1], replace(phase, advance_first=not phase.advance_first)
        yield "gait clock", "the gait clock starts with the other foot", {"phase": replace(phase, offsets=other_foot)}
        title = f"the gait clock is {'' if ahead.advance_first else 'not '}advanced before the first observation"
        yield "gait clock", title, {"phase": ahead}
    for term in terms:
        for scale in contract.kind(term).scales:
            yield "scale", f"{term.name} is multiplied by {scale:g}", _with_term(contract, term, scale=scale)
    if any(term.history > 1 for term in terms):
        for first in ("oldest_first", "newest_first"):
            ordered = [replace(term, history_order=first) for term in terms]
            yield "history", f"histories are {first}", {"observation": ordered}
        for layout in ("per_term", "per_step"):
            yield "history", f"the history is ordered {layout}", {"history_layout": layout}


def _conventions(contract: PolicyContract, term: Term) -> Iterator[tuple[str, Any]]:
    """Yield options of a term with the values that exporters differ in."""
    kind = contract.kind(term)
    values: dict[str, Sequence[Any]] = {name: get_args(hint) for name, hint in get_type_hints(Term).items()}
    values |= {"sign": (-np.asarray(term.scale),), "relative": (not kind.is_relative(term),)}
    values |= {"inverse": (not term.inverse,), "at": (BASE, IMU)}
    for convention in kind.conventions:
        for value in values[convention]:
            yield "scale" if convention == "sign" else convention, value


# --- actions, pose, gains, rate ---


def _action_changes(contract: PolicyContract, robot: RobotDescription, orders: Orders) -> Changes:
    names, scale, pose = contract.joint_names, contract.action_scale, contract.default_joint_pos
    scales: dict[str, Any] = {f"{value:g}": value for value in (1.0, 0.5, 0.25)}
    scales |= {f"{factor:g} x as large": factor * scale for factor in (0.5, 2.0, 4.0)}
    for title, order in orders.items():
        scales[f"listed in {title} order"] = scale[_places(contract.action_joint_names, order)]
    for title, value in scales.items():
        yield "action scale", f"the action scale is {title}", {"action_scale": value}
    yield "action offset", "an action is the position itself", {"action_offset": 0.0}
    yield "action offset", "an action is added to the default pose", {"action_offset": None}
    poses = {
        "all zeros": np.zeros(len(names)),
        "the robot's own": np.array(robot.initial_position)[joint_indices(names, robot.joint_names, "joints")],
        **{f"listed in {title} order": pose[_places(names, order)] for title, order in orders.items()},
    }
    if not pose.any():
        bend = np.array([sum(share for part, share in _BENT.items() if re.search(part, name)) for name in names])
        poses |= {f"with bent knees, such as {2.0 * lean:g} rad": lean * bend + 0.0 for lean in _LEANS}
    for title, other in poses.items():
        yield "default pose", f"the default pose is {title}", with_pose(contract, other)
    own = np.stack([contract.joint_stiffness, contract.joint_damping])
    gains = {f"{factor:g} x as large": factor * own for factor in (0.5, 2.0)}
    gains |= {f"listed in {title} order": own[:, _places(names, order)] for title, order in orders.items()}
    for title, (stiffness, damping) in gains.items():
        yield "gains", f"the gains are {title}", {"joint_stiffness": stiffness, "joint_damping": damping}
    for rate in (25.0, 50.0, 100.0):
        yield "rate", f"the policy runs at {rate:g} Hz", {"policy_dt": 1.0 / rate}


def with_pose(contract: PolicyContract, pose: FloatArray) -> dict[str, Any]:
    """Return the fields with another default pose; the action's offset moves along where it was the old one."""
    old = contract.default_joint_pos[[contract.joint_names.index(name) for name in contract.action_joint_names]]
    follows = np.array_equal(np.asarray(contract.action_offset), old)
    return {"default_joint_pos": pose, "action_offset": None if follows else contract.action_offset}
