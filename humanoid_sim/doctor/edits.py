"""Single edits of a contract: what usually is wrong about one, put right, one change at a time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from itertools import combinations, pairwise
from typing import Any, get_args

import numpy as np

from humanoid_sim.controllers.contract import TERM_CHOICES, PhaseRule, PolicyContract, TensorNames, Term
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.terms import TERM_KINDS, value_names
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import BASE, IMU, FloatArray
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.mjcf import bare_model, own_actuators, own_joint_damping
from humanoid_sim.simulation.model import base_body, breadth_first, build_model, joints_of

_SIDES = (("left", "right"), ("Left", "Right"), ("LL", "LR"), ("L_", "R_"), ("l_", "r_"), ("_L", "_R"), ("_l", "_r"))
_LEGGED_GYM: Mapping[str, Any] = {"base_ang_vel": 0.25, "joint_vel": 0.05}
_COMMANDS: Mapping[str, Any] = {
    **{"base_lin_vel": 2.0, "velocity_command": (2.0, 2.0, 0.25), "command_lin_vel": 2.0, "command_ang_vel": 0.25}
}
_ZOO = {"all 1": {}, "legged_gym's": _LEGGED_GYM, "legged_gym's, commands too": {**_LEGGED_GYM, **_COMMANDS}}
_OF_JOINTS = ("joint_stiffness", "joint_damping", "default_joint_pos", "effort_limit")
_OF_ACTIONS = ("action_scale", "action_offset", "position_clip")
_GAINS = ("joint_stiffness", "joint_damping")
_DOUBTS = {"one gain": 0.25, "rate": 0.15, "two joints": 0.1, "joint sign": 0.03}
_BENT = {"hip_?pitch|HFE": -1.0, "knee|KFE": 2.0, "ankle_?pitch|FFE": -1.0}
"""Joints that bend where a humanoid stands with bent knees, and by how much, in shares of the shank's lean."""

Changes = Iterator[tuple[str, str, dict[str, Any]]]
"""Name, family, and the fields of the contract that change."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotFacts:
    """What the edits need of a robot and a motion. Arrays are of shape (n,), in the robot's order."""

    joint_names: tuple[str, ...]
    """In the order of the MJCF, and of its actuators."""
    breadth_first: tuple[str, ...]
    """Level by level through the kinematic tree, as Isaac orders them."""
    effort_limit: FloatArray
    """N·m, infinite where it has none."""
    stiffness: FloatArray
    """N·m/rad, the robot's own gains, or its model's; zeros without any."""
    damping: FloatArray
    """N·m·s/rad, likewise."""
    initial_position: FloatArray
    """rad"""
    has_joint_damping: bool = False
    """The robot's model damps its joints itself."""
    motion_bodies: tuple[str, ...] = ()
    """Bodies whose world poses the motion holds."""
    points: tuple[str, ...] = ()
    """Sites whose velocity a policy may observe."""


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


def robot_facts(description: RobotDescription, motion: Motion | None) -> RobotFacts:
    """Return what the edits need. Raises `InputError` if the robot's MJCF cannot be built."""
    names, model, bare = description.joint_names, build_model(description, scene=False), bare_model(description)
    sites = [model.site(i) for i in range(model.nsite) if description.is_floating and model.site(i).name]
    base = base_body(model, description)
    own = own_actuators(bare)
    gains = np.array([(own[name].stiffness, own[name].damping) if name in own else (0.0, 0.0) for name in names]).T
    return RobotFacts(
        joint_names=names,
        breadth_first=joints_of(model, breadth_first(model), names),
        effort_limit=description.effort_limit,
        stiffness=description.stiffness if description.stiffness.any() else gains[0],
        damping=description.damping if description.stiffness.any() else gains[1],
        initial_position=np.array(description.initial_position),
        has_joint_damping=bool(own_joint_damping(bare, description)),
        motion_bodies=motion.body_names if motion is not None and motion.layout == "joints_bodies_w" else (),
        points=tuple(
            site.name
            for site in sites
            if (int(site.bodyid[0]) == base or "imu" in site.name.lower()) and site.name != description.imu
        ),
    )


def single_edits(
    contract: PolicyContract, robot: RobotFacts, *, all_pairs: bool = False, more: Iterable[Edit] = ()
) -> tuple[Edit, ...]:
    """Return every edit that fits the contract and changes it, no edited contract twice.

    Args:
        more: further edits of this contract.
        all_pairs: swap any two joints, not only neighbours in the list or on a limb, and mirror images.
    """
    found: dict[str, Edit | None] = {contract_key(contract): None}
    unlike = asymmetry(contract)
    for changes in (
        _joint_orders(contract, robot, all_pairs),
        _term_orders(contract),
        _conventions(contract, robot),
        _references(contract, robot),
        _phases(contract),
        _scales(contract),
        _histories(contract),
        _actions(contract, robot),
        _poses(contract, robot),
        _gains(contract, robot),
        _rates(),
        _joint_signs(contract),
    ):
        for name, family, changed in changes:
            try:
                edited = replace(contract, **changed)
            except FieldError:  # the change does not fit this contract
                continue
            if "gain" not in family or asymmetry(edited) <= unlike:  # robots are alike on both sides
                doubt = _DOUBTS.get(family, 0.0)
                found.setdefault(contract_key(edited), Edit(name, family, edited, doubt))
    for edit in more:
        found.setdefault(contract_key(edit.contract), edit)
    return tuple(edit for edit in found.values() if edit is not None)


# --- joints ---


def _orders(contract: PolicyContract, robot: RobotFacts) -> dict[str, tuple[str, ...]]:
    orders = {
        "the robot's": robot.joint_names,
        "breadth-first (Isaac)": robot.breadth_first,
        "alphabetical": tuple(sorted(contract.joint_names)),
    }
    return {title: order for title, order in orders.items() if sorted(order) == sorted(contract.joint_names)}


def _listed(contract: PolicyContract, robot: RobotFacts, joints: tuple[str, ...]) -> dict[str, Any]:
    """Return, by the order that a list of values may be in, the place in it of each of `joints`."""
    orders = _orders(contract, robot)
    return {title: _places(joints, tuple(n for n in order if n in joints)) for title, order in orders.items()}


def _joint_orders(contract: PolicyContract, robot: RobotFacts, all_pairs: bool) -> Changes:
    names, place = contract.joint_names, {name: i for i, name in enumerate(robot.joint_names)}
    for title, order in _orders(contract, robot).items():
        yield f"joint_names is in {title} order", "joint order", _relabelled(contract, order)
        name = f"the network has its joints, and their values, in {title} order"
        yield name, "joint order", _reordered(contract, order)
    mirror = mirrored(names)
    for one, other in combinations(names, 2):
        is_near = abs(names.index(one) - names.index(other)) == 1 or mirror.get(one) == other
        is_near |= abs(place[one] - place[other]) == 1 and _side(one) == _side(other)
        if all_pairs or is_near:
            swap = {one: other, other: one}
            order = tuple(swap.get(name, name) for name in names)
            yield f"{one} and {other} are in each other's places", "two joints", _relabelled(contract, order)


def _relabelled(contract: PolicyContract, order: tuple[str, ...]) -> dict[str, Any]:
    """Give the joints, place by place, the names of `order`; all values stay in place."""
    names = dict(zip(contract.joint_names, order, strict=True))
    shown = [None if term.joints is None else tuple(names[name] for name in term.joints) for term in contract.terms]
    terms = [replace(term, joints=joints) for term, joints in zip(contract.terms, shown, strict=True)]
    driven = tuple(names[name] for name in contract.action_joint_names)
    return {"observation": terms, "joint_names": order, "action_joint_names": driven}


def _reordered(contract: PolicyContract, order: tuple[str, ...]) -> dict[str, Any]:
    """Sort the joints, and all values that belong to them, into `order`."""
    driven = tuple(name for name in order if name in contract.action_joint_names)
    joints, actions = _places(order, contract.joint_names), _places(driven, contract.action_joint_names)
    moved: dict[str, Any] = {"joint_names": order, "action_joint_names": driven}
    for names, places in ((_OF_JOINTS, joints), (_OF_ACTIONS, actions)):
        for name in names:
            value = getattr(contract, name)
            moved[name] = value[places] if isinstance(value, np.ndarray) else value
    return moved


def _joint_signs(contract: PolicyContract) -> Changes:
    for name in contract.joint_names:
        title = f"{name} turns the other way in the policy than on the robot"
        yield title, "joint sign", _turned(contract, name, -1.0)
        yield f"{title}, but for its default angle", "joint sign", _turned(contract, name, 1.0)


def _turned(contract: PolicyContract, name: str, angle: float) -> dict[str, Any]:
    """Turn one joint round in all that the policy sees of it and does with it; `angle` is its default angle's sign."""
    of_joint = np.where(np.array(contract.joint_names) == name, angle, 1.0)
    is_driven = np.array(contract.action_joint_names) == name
    clip, terms = contract.position_clip, []
    for term in contract.terms:
        kind, factor = contract.kind(term), np.array(1.0)
        # The reference, and the network's own output, are in the policy's directions already.
        if kind.reads.startswith("joint_") or term.form == "scaled":
            factor = np.where(np.array(value_names(term, contract)) == name, -1.0, 1.0)
        terms.append(replace(term, scale=term.scale * factor))
    return {
        "observation": terms,
        "action_scale": np.where(is_driven, -contract.action_scale, contract.action_scale),
        "default_joint_pos": contract.default_joint_pos * of_joint,
        "action_offset": contract.action_offset * np.where(is_driven, angle, 1.0),
        "position_clip": np.sort(clip * np.where(is_driven, -1.0, 1.0)[:, None])
        if isinstance(clip, np.ndarray)
        else clip,
    }


def _side(name: str) -> str:
    return next((word for words in _SIDES for word in words if word in name), "")


def mirrored(names: tuple[str, ...]) -> dict[str, str]:
    """Each joint's counterpart on the other side; joints without one are left out."""
    found: dict[str, str] = {}
    for name in names:
        for left, right in _SIDES:
            other = name.replace(left, right, 1)
            if other != name and other in names and not {name, other} & found.keys():
                found |= {name: other, other: name}
    return found


def asymmetry(contract: PolicyContract) -> int:
    """Count the joints whose gains, or magnitudes of scale and pose, are not those of their counterpart."""
    names = contract.joint_names
    scale = dict(zip(contract.action_joint_names, contract.action_scale, strict=True))
    scales = np.array([scale.get(name, 0.0) for name in names])
    values = np.abs([contract.joint_stiffness, contract.joint_damping, contract.default_joint_pos, scales])
    mirror = mirrored(names)
    other = values[:, [names.index(mirror.get(name, name)) for name in names]]
    return int((~np.isclose(values, other, rtol=1e-3)).any(axis=0).sum())


# --- observation ---


def with_term(contract: PolicyContract, term: Term, **options: Any) -> list[Term]:
    """Return the contract's terms with options of one of them set."""
    return [replace(item, **options) if item.name == term.name else item for item in contract.terms]


def _conventions(contract: PolicyContract, robot: RobotFacts) -> Changes:
    points = {BASE: "the base's origin", IMU: "the IMU", **{site: f"the site {site}" for site in robot.points}}
    for term in contract.terms:
        kind, changes = contract.kind(term), dict[str, tuple[str, dict[str, Any]]]()
        if "sign" in kind.conventions:
            changes["has the other sign"] = "sign", {"scale": -np.asarray(term.scale)}
        if "relative" in kind.conventions:
            relative = not kind.is_relative(term)
            title = f"holds angles {'less the default pose' if relative else 'themselves'}"
            changes[title] = "relative", {"relative": None if relative == kind.relative else relative}
        if "inverse" in kind.conventions:
            seen = "the reference seen from the robot" if term.inverse else "the robot seen from the reference"
            changes[f"is {seen}"] = "inverse", {"inverse": not term.inverse}
        if "at" in kind.conventions:
            changes |= {f"is that of {point}": ("point", {"at": at}) for at, point in points.items()}
        for option in ("frame", "quaternion", "form", "layout"):
            for other in get_args(TERM_CHOICES[option]) if option in kind.conventions else ():
                if other != getattr(term, option):
                    changes[f"has the {option} {other}"] = option, {option: other}
        for title, (about, options) in changes.items():
            yield f"{term.name} {title}", f"{term.name} {about}", {"observation": with_term(contract, term, **options)}


def _references(contract: PolicyContract, robot: RobotFacts) -> Changes:
    if not contract.requires("anchor_body"):
        return
    for body in robot.motion_bodies:
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
    others = {
        "starts with the other foot": replace(rule, offsets=rule.offsets[::-1]),
        f"is {'not ' if rule.advance_first else ''}advanced before the first observation": replace(
            rule, advance_first=not rule.advance_first
        ),
    }
    if rule.period is not None:
        others |= {f"has a period of {period:g} s": replace(rule, period=period) for period in (0.6, 0.8, 1.0)}
    for title, phase in others.items():
        yield f"the gait clock {title}", "gait clock", {"phase": phase}


def _scales(contract: PolicyContract) -> Changes:
    for title, values in _ZOO.items():
        terms = [replace(term, scale=values.get(contract.kind(term).name, 1.0)) for term in contract.terms]
        yield f"the observation's scales are {title}", "scales", {"observation": terms}
    for term in contract.terms:
        for scale in contract.kind(term).scales:
            changed = {"observation": with_term(contract, term, scale=scale)}
            yield f"{term.name} is multiplied by {scale:g}", f"{term.name} scale", changed


def _term_orders(contract: PolicyContract) -> Changes:
    terms, listed = contract.terms, list(TERM_KINDS)  # listed as legged_gym and Isaac Lab do
    kinds = {term.name: contract.kind(term).name for term in terms}
    places = {name: listed.index(kind) for name, kind in kinds.items() if kind in listed}
    orders = {
        "the terms are in alphabetical order": sorted(terms, key=lambda term: term.name),
        "the terms are in the order of task configurations": sorted(terms, key=lambda t: places.get(t.name, 99)),
    }
    for i, (one, other) in enumerate(pairwise(terms)):
        orders[f"{other.name} comes before {one.name}"] = [*terms[:i], other, one, *terms[i + 2 :]]
    for title, order in orders.items():
        yield title, "term order", {"observation": order}


def _histories(contract: PolicyContract) -> Changes:
    if all(term.history == 1 for term in contract.terms):
        return
    for order in ("oldest_first", "newest_first"):
        terms = [replace(term, history_order=order) for term in contract.terms]
        yield f"histories are {order.replace('_', ' ')}", "history", {"observation": terms}
    for layout in ("per_term", "per_step"):
        yield f"the history is laid out {layout.replace('_', ' ')}", "history", {"history_layout": layout}


# --- actions, pose, gains, rate ---


def _actions(contract: PolicyContract, robot: RobotFacts) -> Changes:
    scale, efforts = contract.action_scale, robot.effort_limit[_places(contract.joint_names, robot.joint_names)]
    values: dict[str, Any] = {f"{value:g}": value for value in (1.0, 0.5, 0.25)}
    values |= {f"{factor:g} x as large": factor * scale for factor in (0.5, 2.0, 4.0)}
    if (contract.joint_stiffness > 0.0).all():  # as mjlab computes it; refused where an effort is infinite
        own = (0.25 * efforts / contract.joint_stiffness)[_places(contract.action_joint_names, contract.joint_names)]
        values["0.25 x effort limit / stiffness"] = np.round(own, 3)
    listed = _listed(contract, robot, contract.action_joint_names)
    values |= {f"listed in {title} order": scale[places] for title, places in listed.items()}
    for title, value in values.items():
        yield f"the action scale is {title}", "action scale", {"action_scale": value}
    yield "an action is the position itself", "action offset", {"action_offset": 0.0}
    yield "an action is added to the default pose", "action offset", {"action_offset": None}


def with_pose(contract: PolicyContract, pose: FloatArray) -> dict[str, Any]:
    """Return the fields with another default pose; the action's offset moves along where it was the old one."""
    old = contract.default_joint_pos[_places(contract.action_joint_names, contract.joint_names)]
    follows = np.array_equal(np.asarray(contract.action_offset), old)
    return {"default_joint_pos": pose, "action_offset": None if follows else contract.action_offset}


def _poses(contract: PolicyContract, robot: RobotFacts) -> Changes:
    names, pose = contract.joint_names, contract.default_joint_pos
    poses = {"all zeros": 0.0 * pose, "the robot's own": robot.initial_position[_places(names, robot.joint_names)]}
    listed = _listed(contract, robot, names)
    poses |= {f"listed in {title} order": pose[places] for title, places in listed.items()}
    if not pose.any():
        bend = sum(np.array([share * bool(re.search(part, name)) for name in names]) for part, share in _BENT.items())
        for lean in (0.15, 0.3, -0.15, -0.3):
            poses[f"one with bent knees, such as {2.0 * lean:g} rad"] = lean * np.asarray(bend)
    for title, other in poses.items():
        yield f"the default pose is {title}", "default pose", with_pose(contract, other)


def _gains(contract: PolicyContract, robot: RobotFacts) -> Changes:
    own = np.stack([contract.joint_stiffness, contract.joint_damping])
    values = {f"the gains are {factor:g} x as large": factor * own for factor in (0.5, 2.0)}
    for title, places in _listed(contract, robot, contract.joint_names).items():
        values[f"the gains are listed in {title} order"] = own[:, places]
    if robot.stiffness.any():
        order = _places(contract.joint_names, robot.joint_names)
        values["the gains are those of the robot"] = np.stack([robot.stiffness, robot.damping])[:, order]
    for factor in (0.5, 2.0):
        values[f"joint_stiffness is {factor:g} x as large"] = own * [[factor], [1.0]]
        values[f"joint_damping is {factor:g} x as large"] = own * [[1.0], [factor]]
    for title, (stiffness, damping) in values.items():
        family = "one gain" if title.startswith("joint_") else "gains"
        yield title, family, {"joint_stiffness": stiffness, "joint_damping": damping}
    for treatment in ("keep", "drop") if robot.has_joint_damping else ():
        title = f"the model's own joint damping is {'kept' if treatment == 'keep' else 'dropped'}"
        yield title, "model damping", {"model_joint_damping": treatment}


def _rates() -> Changes:
    for rate in (25.0, 50.0, 100.0):
        yield f"the policy runs at {rate:g} Hz", "rate", {"policy_dt": 1.0 / rate}


def _places(joints: tuple[str, ...], order: tuple[str, ...]) -> Any:
    """Return the place in `order` of each of `joints`."""
    return joint_indices(joints, order, "joints")


# --- comparison ---


def contract_key(contract: PolicyContract) -> str:
    """Return the same for contracts that wire a policy alike; where their fields came from does not count."""
    return repr([plain(getattr(contract, name)) for name in FIELDS])


def plain(value: Any) -> Any:
    """Return a value as a contract file has it: of a term or a clock what is not the default, one number for all."""
    if isinstance(value, np.ndarray):
        listed = (value + 0.0).round(9).tolist()  # -0 is 0
        return listed[0] if value.ndim == 1 and value.size and (value == value[0]).all() else listed
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if not is_dataclass(value):
        return value
    kept: dict[str, Any] = {}
    for item in fields(value):
        own, usual = plain(getattr(value, item.name)), _DEFAULTS[type(value).__name__, item.name]
        if own != usual and (item.name != "kind" or own != Term(kept["name"]).kind):
            kept[item.name] = own
    return kept["name"] if list(kept) == ["name"] else kept


FIELDS = tuple(item.name for item in fields(PolicyContract) if item.name != "source")
_DEFAULTS = {
    (kind.__name__, item.name): plain(item.default_factory() if item.default_factory is not MISSING else item.default)
    for kind in (Term, PhaseRule, TensorNames)
    for item in fields(kind)
}
