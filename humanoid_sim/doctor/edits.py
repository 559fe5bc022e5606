"""Single edits of a contract: what usually is wrong about one, put right, one change at a time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any, get_args

import numpy as np

from humanoid_sim.controllers.contract import TERM_CHOICES, PolicyContract, Term
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.terms import value_names
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import BASE, IMU, FloatArray
from humanoid_sim.names import mirrored_pairs
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.readers.own import flattened, plain
from humanoid_sim.policy.words import shown
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import breadth_first, build_model, joints_of

_SCALES: Mapping[str, Mapping[str, Any]] = {
    "all 1": {},
    "unitree_rl_lab's": {"base_ang_vel": 0.2, "joint_vel": 0.05},
    "legged_gym's": {
        **{"base_lin_vel": 2.0, "base_ang_vel": 0.25, "joint_vel": 0.05},
        **{"velocity_command": (2.0, 2.0, 0.25), "command_lin_vel": 2.0, "command_ang_vel": 0.25},
    },
}
_OF_JOINTS = ("joint_stiffness", "joint_damping", "default_joint_pos", "effort_limit")
_OF_ACTIONS = ("action_scale", "action_offset", "position_clip")
_DOUBTS = {"rate": 0.15, "two joints": 0.1, "joint sign": 0.03}
_BENT = {"hip_?pitch|HFE": -1.0, "knee|KFE": 2.0, "ankle_?pitch|FFE": -1.0}
"""Joints that bend where a humanoid stands with bent knees, and by how much, in shares of the shank's lean."""

Orders = Mapping[str, tuple[str, ...]]
"""By what they are called, orders that all joints of the policy may be in."""
Changes = Iterator[tuple[str, str, dict[str, Any]]]
"""Name, family, and the fields of the contract that change."""


@dataclass(frozen=True, slots=True, eq=False)
class Edit:
    """One change to a contract that may put it right."""

    name: str
    """What is so in the edited contract, to compare with the training configuration."""
    family: str
    """Subject of the change."""
    contract: PolicyContract
    """The edited one."""
    doubt: float = 0.0
    """Share of its own errors by which it has to do better: few contracts are wrong in this way."""


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


def single_edits(
    contract: PolicyContract,
    robot: RobotDescription,
    motion: Motion | None = None,
    *,
    all_pairs: bool = False,
    more: Iterable[Edit] = (),
) -> tuple[Edit, ...]:
    """Return every edit that fits the contract and changes it, no edited contract twice.

    Args:
        motion: that the policy follows.
        all_pairs: swap any two joints, not only neighbours in the list or on the robot, and mirror images.
        more: further edits of this contract.
    """
    orders = {
        "the robot's": robot.joint_names,
        "breadth-first (Isaac)": isaac_order(robot),
        "alphabetical": tuple(sorted(contract.joint_names)),
    }
    orders = {title: order for title, order in orders.items() if sorted(order) == sorted(contract.joint_names)}
    found: dict[str, Edit | None] = {str(wiring_values(contract)): None}
    unlike = asymmetry(contract)
    for changes in (
        _joint_orders(contract, orders),
        _joint_pairs(contract, None if all_pairs else robot.joint_names),
        _term_orders(contract),
        _conventions(contract),
        _references(contract, motion),
        _phases(contract),
        _scales(contract),
        _histories(contract),
        _actions(contract, orders),
        _poses(contract, orders, robot),
        _gains(contract, orders),
        _rates(),
        _joint_signs(contract),
    ):
        for name, family, changed in changes:
            try:
                edited = replace(contract, **changed)
            except FieldError:  # the change does not fit this contract
                continue
            if family != "gains" or asymmetry(edited) <= unlike:  # robots are alike on both sides
                edit = Edit(name, family, edited, _DOUBTS.get(family, 0.0))
                found.setdefault(str(wiring_values(edited)), edit)
    for edit in more:
        found.setdefault(str(wiring_values(edit.contract)), edit)
    return tuple(edit for edit in found.values() if edit is not None)


def asymmetry(contract: PolicyContract) -> int:
    """Count the pairs of joints, left and right, whose gains, or magnitudes of scale and pose, differ."""
    scale = dict(zip(contract.action_joint_names, contract.action_scale, strict=True))
    scales = np.array([scale.get(name, 0.0) for name in contract.joint_names])
    rows = np.abs([contract.joint_stiffness, contract.joint_damping, contract.default_joint_pos, scales]).T
    values = dict(zip(contract.joint_names, rows, strict=True))
    pairs = mirrored_pairs(contract.joint_names)
    return sum(not np.allclose(values[left], values[right], rtol=1e-3) for left, right in pairs)


# --- joints ---


def _places(joints: tuple[str, ...], order: tuple[str, ...]) -> Any:
    """Return the place of each of `joints` in a list in this order, which may have more joints."""
    return joint_indices(joints, tuple(name for name in order if name in joints), "joints")


def _joint_orders(contract: PolicyContract, orders: Orders) -> Changes:
    for title, order in orders.items():
        yield f"joint_names is in {title} order", "joint order", _relabelled(contract, order)
        name = f"the network has its joints, and their values, in {title} order"
        yield name, "joint order", _reordered(contract, order)


def _joint_pairs(contract: PolicyContract, robot_joints: tuple[str, ...] | None) -> Changes:
    """Swap two joints; with the robot's, only such that are easily mistaken for each other."""
    names = contract.joint_names
    near = {*pairwise(names), *pairwise(robot_joints or ()), *mirrored_pairs(names)}
    for one, other in combinations(names, 2):
        if robot_joints is None or (one, other) in near or (other, one) in near:
            swap = {one: other, other: one}
            order = tuple(swap.get(name, name) for name in names)
            yield f"{one} and {other} are in each other's places", "two joints", _relabelled(contract, order)


def _relabelled(contract: PolicyContract, order: tuple[str, ...]) -> dict[str, Any]:
    """Give the joints, place by place, the names of `order`; all values stay in place."""
    names = dict(zip(contract.joint_names, order, strict=True))
    terms = [
        term if term.joints is None else replace(term, joints=tuple(names[joint] for joint in term.joints))
        for term in contract.terms
    ]
    driven = tuple(names[name] for name in contract.action_joint_names)
    return {"observation": terms, "joint_names": order, "action_joint_names": driven}


def _reordered(contract: PolicyContract, order: tuple[str, ...]) -> dict[str, Any]:
    """Sort the joints, and all values that belong to them, into `order`."""
    driven = tuple(name for name in order if name in contract.action_joint_names)
    joints, actions = (
        joint_indices(order, contract.joint_names, ""),
        joint_indices(driven, contract.action_joint_names, ""),
    )
    moved: dict[str, Any] = {"joint_names": order, "action_joint_names": driven}
    for names, places in ((_OF_JOINTS, joints), (_OF_ACTIONS, actions)):
        for name in names:
            value = getattr(contract, name)
            moved[name] = value[places] if isinstance(value, np.ndarray) else value
    return moved


def _joint_signs(contract: PolicyContract) -> Changes:
    """Turn each joint round in all that the policy sees of it and does with it."""
    for name in contract.joint_names:
        of_joint = np.where(np.array(contract.joint_names) == name, -1.0, 1.0)
        of_action = np.where(np.array(contract.action_joint_names) == name, -1.0, 1.0)
        terms = []
        for term in contract.terms:
            # The reference, and the network's own output, are in the policy's directions already.
            if contract.kind(term).reads.startswith("joint_") or term.form == "scaled":
                factor = np.where(np.array(value_names(term, contract)) == name, -1.0, 1.0)
                terms.append(replace(term, scale=term.scale * factor))
            else:
                terms.append(term)
        changed = {
            "observation": terms,
            "action_scale": contract.action_scale * of_action,
            "default_joint_pos": contract.default_joint_pos * of_joint + 0.0,  # -0 is 0
            "action_offset": contract.action_offset * of_action + 0.0,
        }
        yield f"{name} turns the other way in the policy than on the robot", "joint sign", changed


# --- observation ---


def with_term(contract: PolicyContract, term: Term, **options: Any) -> list[Term]:
    """Return the contract's terms with options of one of them set."""
    return [replace(item, **options) if item.name == term.name else item for item in contract.terms]


def _conventions(contract: PolicyContract) -> Changes:
    for term in contract.terms:
        kind = contract.kind(term)
        for convention in kind.conventions:
            option = "scale" if convention == "sign" else convention
            values = get_args(TERM_CHOICES.get(convention))
            if convention == "sign":
                values = (-np.asarray(term.scale),)
            elif convention == "relative":
                values = (not kind.is_relative(term),)
            elif convention == "inverse":
                values = (not term.inverse,)
            elif convention == "at":
                values = (BASE, IMU)
            for value in values:
                terms = with_term(contract, term, **{option: value})
                yield f"{option} of {term.name} is {shown(value)}", f"{term.name} {convention}", {"observation": terms}


def _term_orders(contract: PolicyContract) -> Changes:
    terms = contract.terms
    orders: dict[str, Sequence[Term]] = {
        "the terms are in alphabetical order": sorted(terms, key=lambda term: term.name)
    }
    for i, (one, other) in enumerate(pairwise(terms)):
        orders[f"{other.name} comes before {one.name}"] = [*terms[:i], other, one, *terms[i + 2 :]]
    for title, order in orders.items():
        yield title, "term order", {"observation": order}


def _references(contract: PolicyContract, motion: Motion | None) -> Changes:
    if motion is None or motion.layout != "joints_bodies_w" or not contract.requires("anchor_body"):
        return
    for body in motion.body_names:
        yield f"the anchor body is {body}", "anchor body", {"anchor_body": body}
    turned = not contract.align_reference
    title = f"the reference is {'' if turned else 'not '}turned to the robot's heading at the start"
    yield title, "reference alignment", {"align_reference": turned}
    for order in ("xyzw", "wxyz"):
        title = f"the motion's quaternions are ordered {' '.join(order)}"
        yield title, "reference quaternions", {"reference_quaternion": order}


def _phases(contract: PolicyContract) -> Changes:
    rule = contract.phase
    if rule is None or not contract.requires("phase"):
        return
    feet = replace(rule, offsets=rule.offsets[::-1])
    yield "the gait clock starts with the other foot", "gait clock", {"phase": feet}
    title = f"the gait clock is {'not ' if rule.advance_first else ''}advanced before the first observation"
    yield title, "gait clock", {"phase": replace(rule, advance_first=not rule.advance_first)}


def _scales(contract: PolicyContract) -> Changes:
    for title, values in _SCALES.items():
        terms = [replace(term, scale=values.get(contract.kind(term).name, 1.0)) for term in contract.terms]
        yield f"the observation's scales are {title}", "scales", {"observation": terms}
    for term in contract.terms:
        for scale in contract.kind(term).scales:
            changed = {"observation": with_term(contract, term, scale=scale)}
            yield f"{term.name} is multiplied by {scale:g}", f"{term.name} scale", changed


def _histories(contract: PolicyContract) -> Changes:
    if all(term.history == 1 for term in contract.terms):
        return
    for order in ("oldest_first", "newest_first"):
        terms = [replace(term, history_order=order) for term in contract.terms]
        yield f"histories are {order.replace('_', ' ')}", "history", {"observation": terms}
    for layout in ("per_term", "per_step"):
        yield f"the history is laid out {layout.replace('_', ' ')}", "history", {"history_layout": layout}


# --- actions, pose, gains, rate ---


def _actions(contract: PolicyContract, orders: Orders) -> Changes:
    scale = contract.action_scale
    values: dict[str, Any] = {f"{value:g}": value for value in (1.0, 0.5, 0.25)}
    values |= {f"{factor:g} x as large": factor * scale for factor in (0.5, 2.0, 4.0)}
    for title, order in orders.items():
        values[f"listed in {title} order"] = scale[_places(contract.action_joint_names, order)]
    for title, value in values.items():
        yield f"the action scale is {title}", "action scale", {"action_scale": value}
    yield "an action is the position itself", "action offset", {"action_offset": 0.0}
    yield "an action is added to the default pose", "action offset", {"action_offset": None}


def with_pose(contract: PolicyContract, pose: FloatArray) -> dict[str, Any]:
    """Return the fields with another default pose; the action's offset moves along where it was the old one."""
    old = contract.default_joint_pos[[contract.joint_names.index(name) for name in contract.action_joint_names]]
    follows = np.array_equal(np.asarray(contract.action_offset), old)
    return {"default_joint_pos": pose, "action_offset": None if follows else contract.action_offset}


def _poses(contract: PolicyContract, orders: Orders, robot: RobotDescription) -> Changes:
    names, pose = contract.joint_names, contract.default_joint_pos
    poses = {
        "all zeros": np.zeros(len(names)),
        "the robot's own": np.array(robot.initial_position)[joint_indices(names, robot.joint_names, "joints")],
        **{f"listed in {title} order": pose[_places(names, order)] for title, order in orders.items()},
    }
    if not pose.any():
        bend = sum(np.array([share * bool(re.search(part, name)) for name in names]) for part, share in _BENT.items())
        for lean in (0.15, 0.3, -0.15, -0.3):
            poses[f"one with bent knees, such as {2.0 * lean:g} rad"] = lean * np.asarray(bend) + 0.0
    for title, other in poses.items():
        yield f"the default pose is {title}", "default pose", with_pose(contract, other)


def _gains(contract: PolicyContract, orders: Orders) -> Changes:
    own = np.stack([contract.joint_stiffness, contract.joint_damping])
    values = {f"{factor:g} x as large": factor * own for factor in (0.5, 2.0)}
    for title, order in orders.items():
        values[f"listed in {title} order"] = own[:, _places(contract.joint_names, order)]
    for title, (stiffness, damping) in values.items():
        yield f"the gains are {title}", "gains", {"joint_stiffness": stiffness, "joint_damping": damping}


def _rates() -> Changes:
    for rate in (25.0, 50.0, 100.0):
        yield f"the policy runs at {rate:g} Hz", "rate", {"policy_dt": 1.0 / rate}
