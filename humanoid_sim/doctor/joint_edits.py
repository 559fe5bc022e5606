"""Hypotheses about joints (order, direction, places, gains) and about actions: scale, offset, default pose, rate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import FORMS, PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.terms import Term
from humanoid_sim.doctor.edits import (
    JOINT_DOUBT,
    LIMBS,
    RATE_DOUBT,
    STRONG_DOUBT,
    Change,
    Edit,
    RobotFacts,
    change_terms,
    limb,
    mirrored,
    set_fields,
)
from humanoid_sim.mit import FloatArray


def joint_orders(contract: PolicyContract, robot: RobotFacts) -> Iterator[Edit]:
    """Yield other orders of the joints: of the names alone, or of the observation and action alone."""
    mirror = mirrored(contract.joint_names)
    orders = {
        "the robot's": robot.joint_names,
        "breadth-first (Isaac)": robot.breadth_first,
        "alphabetical": tuple(sorted(contract.joint_names)),
        "with left and right swapped": tuple(mirror.get(name, name) for name in contract.joint_names),
    }
    for title, order in orders.items():
        if sorted(order) != sorted(contract.joint_names) or order == contract.joint_names:
            continue
        name, cause = f"joint order {title}", "joint order"
        text = f"joint_names is {title} order; the lists of gains, pose and scale are in that order already"
        yield Edit(f"{name}, values stay in place", cause, text, partial(_relabelled, order))
        text = f"the policy sees and drives the joints in {title} order; gains, pose and scale belong to their joints"
        yield Edit(f"{name}, values move along", cause, text, partial(_reordered, order))


def _relabelled(order: tuple[str, ...], contract: PolicyContract) -> PolicyContract:
    """Give the joints, place by place, the names of `order`."""
    names = dict(zip(contract.joint_names, order, strict=True))

    def renamed(term: Term) -> Term:
        return replace(term, joints=term.joints and tuple(names[name] for name in term.joints))

    driven = tuple(names[name] for name in contract.action_joint_names)
    return replace(change_terms(contract, renamed), joint_names=order, action_joint_names=driven)


def _reordered(order: tuple[str, ...], contract: PolicyContract) -> PolicyContract:
    """Sort the joints and everything that belongs to them into `order`."""
    joints = joint_indices(order, contract.joint_names, "joints of the policy")
    driven = tuple(name for name in order if name in contract.action_joint_names)
    actions = joint_indices(driven, contract.action_joint_names, "action joints of the policy")
    places = {"joint_names": joints, "action_joint_names": actions}
    moved: dict[str, Any] = {
        name: value[places[form.joints]]
        for name, form in FORMS.items()
        if form.kind != "names" and form.joints and isinstance(value := getattr(contract, name), np.ndarray)
    }
    contract = change_terms(contract, lambda term: _sorted_joints(term, order))
    return replace(contract, joint_names=order, action_joint_names=driven, **moved)


def _sorted_joints(term: Term, order: tuple[str, ...]) -> Term:
    if term.joints is None:
        return term
    shown = tuple(name for name in order if name in term.joints)
    places = [term.joints.index(name) for name in shown]
    scale = np.asarray(term.scale)
    return replace(term, joints=shown, scale=scale[places] if scale.size > 1 else scale)


def joint_signs(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield each joint turned the other way, in all that the policy sees of it and does with it."""
    for name in contract.joint_names:
        for along, which in ((True, ""), (False, ", its default angle stays")):
            text = f"{name} turns the other way in the policy than on the robot{which}"
            change = partial(_turned_round, name, along)
            yield Edit(f"{name} turned round{which}", "joint direction", text, change, JOINT_DOUBT)


def _turned_round(name: str, along: bool, contract: PolicyContract) -> PolicyContract:
    """Turn one joint round; `along`: its default angle too."""
    of_joint = np.where(np.array(contract.joint_names) == name, -1.0, 1.0)
    of_action = np.where(np.array(contract.action_joint_names) == name, -1.0, 1.0)
    clip = contract.position_clip
    if isinstance(clip, np.ndarray):
        clip = np.sort(clip * of_action[:, None], axis=1)

    def seen(term: Term) -> Term:
        kind = contract.kind(term)
        # The reference, and the network's own output, are in the policy's directions already.
        if not kind.reads.startswith("joint_") and term.form != "scaled":
            return term
        joints = np.array(kind.value_names(term, contract))
        return replace(term, scale=term.scale * np.where(joints == name, -1.0, 1.0)) if joints.size else term

    assert contract.action_offset is not None
    return replace(
        change_terms(contract, seen),
        action_scale=contract.action_scale * of_action,
        default_joint_pos=contract.default_joint_pos * (of_joint if along else 1.0),
        action_offset=contract.action_offset * (of_action if along else 1.0),
        position_clip=clip,
    )


def swapped_sides(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield left and right of one limb, or of one kind of joint, swapped."""
    names, mirror = contract.joint_names, mirrored(contract.joint_names)
    groups = {f"left and right of the {name}": limb(pattern, names) for name, pattern in LIMBS.items()}
    groups |= {f"{name} and {mirror[name]}": (name, mirror[name]) for name in names if name in mirror}
    for title, chosen in groups.items():
        order = tuple(mirror.get(name, name) if name in chosen else name for name in names)
        if order != names:
            text, change = f"joint_names has {title} swapped", partial(_relabelled, order)
            yield Edit(f"{title} swapped", "joint order", text, change, JOINT_DOUBT)


def swapped_gains(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Two joints have each other's gains, on one side or on both.

    All robots are alike on both sides. So where the gains are not, one swap is wrong that makes them more alike; where
    they are, one that keeps them alike.
    """
    names, mirror = contract.joint_names, mirrored(contract.joint_names)
    gains = np.stack([contract.joint_stiffness, contract.joint_damping], axis=1)
    other = np.array([names.index(mirror.get(name, name)) for name in names])

    def unlike(order: npt.NDArray[np.intp]) -> int:
        return int((gains[order] != gains[order][other]).any(axis=1).sum())

    straight = np.arange(len(names))
    now = unlike(straight)
    for i, j in combinations(range(len(names)), 2):
        if (gains[i] == gains[j]).all() or (not mirror and j > i + 1):
            continue
        one = straight.copy()
        one[[i, j]] = j, i
        both = one.copy()
        if len({i, j, other[i], other[j]}) == 4:
            both[other[[i, j]]] = other[[j, i]]
        for order, sides in ((one, ""), (both, ", and on the other side")):
            left = unlike(order)
            if left < now or left == now == 0:
                title = f"gains of {names[i]} and {names[j]} swapped{sides}"
                fields = {name: getattr(contract, name)[order] for name in ("joint_stiffness", "joint_damping")}
                yield Edit(title, "gains of two joints", title, set_fields(**fields), STRONG_DOUBT)


_SCALES = (1.0, 0.5, 0.25)
_SCALE_FACTORS = (0.5, 2.0, 4.0)
_GAIN_FACTORS = (0.5, 2.0)
_BOTH = ("joint_stiffness", "joint_damping")
_MOST_GROUPS = 8
"""Largest number of groups of joints with equal gains; with more groups the gains follow no such rule."""
_RATES = (25.0, 50.0, 100.0)
"""Hz"""
_EFFORT_SHARE = 0.25
"""mjlab and whole_body_tracking scale an action so that 1 asks for a quarter of the joint's effort limit."""
_G1_EFFORTS = {14.251: 25.0, 16.778: 5.0, 28.501: 50.0, 40.179: 88.0, 99.098: 139.0}
"""N·m by stiffness in N·m/rad, of the joints of Unitree's G1 as these two drive it: few of its models have limits."""


def action_scales(contract: PolicyContract, robot: RobotFacts) -> Iterator[Edit]:
    """Yield edits of what the action is multiplied by, and of what it is relative to."""
    scale = "action scale"
    for value in _SCALES:
        text = f"an action is multiplied by {value:g} rad"
        yield Edit(f"action scale {value:g}", scale, text, set_fields(action_scale=value))
    for factor in _SCALE_FACTORS:
        text = f"an action is multiplied by {factor:g} times what the contract says"
        yield Edit(f"action scale × {factor:g}", scale, text, partial(_multiplied, ("action_scale",), factor))
    if (contract.joint_stiffness > 0.0).all():
        text = f"action_scale is {_EFFORT_SHARE:g} · effort limit / stiffness, joint by joint, as mjlab computes it"
        yield Edit("action scale from effort limits", scale, text, partial(_scale_from_efforts, robot))
    for title, order in _listed_orders(robot).items():
        text = f"the values of action_scale are in {title} order"
        yield Edit(f"action scale listed in {title} order", scale, text, partial(_listed, ("action_scale",), order))
    offset = "action offset"
    text = "an action is a joint position itself, not relative to the default pose"
    yield Edit("action offset 0", offset, text, set_fields(action_offset=0.0))
    text = "an action is relative to the default pose"
    yield Edit("action offset the default pose", offset, text, set_fields(action_offset=None))


def default_poses(_: PolicyContract, robot: RobotFacts) -> Iterator[Edit]:
    """Yield default poses: others of the robot's poses, and the values in another order."""
    changes: dict[str, Change] = {
        "all zeros": set_fields(default_joint_pos=0.0),
        "the robot's initial position": partial(_robot_values, robot, {"default_joint_pos": robot.initial_position}),
    }
    for title, order in _listed_orders(robot).items():
        changes[f"listed in {title} order"] = partial(_listed, ("default_joint_pos",), order)
    for title, change in changes.items():
        text = f"default_joint_pos is {title}"
        yield Edit(f"default pose {title}", "default pose", text, partial(_posed, change))


def gains(_: PolicyContract, robot: RobotFacts) -> Iterator[Edit]:
    """Yield gains: stiffer or softer, more or less damped, and the values in another order."""
    both = _BOTH
    for factor in _GAIN_FACTORS:
        for title, names in {"gains": both, both[0]: both[:1], both[1]: both[1:]}.items():
            text = f"{' and '.join(names)} are {factor:g} times what the contract says"
            yield Edit(f"{title} × {factor:g}", "gains", text, partial(_multiplied, names, factor), STRONG_DOUBT)
    for title, order in _listed_orders(robot).items():
        text = f"the values of {' and '.join(both)} are in {title} order"
        yield Edit(f"gains listed in {title} order", "gains", text, partial(_listed, both, order), STRONG_DOUBT)
    if robot.stiffness.any():
        text = f"{' and '.join(both)} are those of the robot's description"
        values = {"joint_stiffness": robot.stiffness, "joint_damping": robot.damping}
        yield Edit("gains of the robot", "gains", text, partial(_robot_values, robot, values), STRONG_DOUBT)


def group_gains(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield gains of a limb alone, and of the joints that have equal gains: motors of one model."""
    groups: dict[str, tuple[str, npt.NDArray[np.bool_]]] = {}
    for name, pattern in LIMBS.items():
        groups[f"the {name}"] = ("gains of a limb", np.isin(contract.joint_names, limb(pattern, contract.joint_names)))
    pairs = np.stack([contract.joint_stiffness, contract.joint_damping], axis=1)
    distinct = np.unique(pairs, axis=0)
    for stiffness, damping in distinct if len(distinct) <= _MOST_GROUPS else ():
        chosen = (pairs == (stiffness, damping)).all(axis=1)
        name = f"the joints with stiffness {stiffness:g} and damping {damping:g}"
        groups[name] = ("gains of equal joints", chosen)
    for name, (cause, chosen) in groups.items():
        if chosen.all() or not chosen.any():
            continue
        joints = [joint for joint, is_one in zip(contract.joint_names, chosen, strict=True) if is_one]
        for factor in _GAIN_FACTORS:
            text = (
                f"joint_stiffness and joint_damping of {name} are {factor:g} times what the contract says "
                f"({', '.join(joints[:3])}{', …' if len(joints) > 3 else ''})"
            )
            factors = np.where(chosen, factor, 1.0)
            yield Edit(f"gains of {name} × {factor:g}", cause, text, partial(_multiplied, _BOTH, factors), STRONG_DOUBT)


def model_damping(contract: PolicyContract, robot: RobotFacts) -> Iterator[Edit]:
    """Yield the damping that the robot's model gives its joints: left out, or kept beside the contract's."""
    if not robot.own_damping:
        return
    drops = contract.model_joint_damping != "drop"
    yield Edit(
        f"the model's joint damping {'dropped' if drops else 'kept'}",
        "model joint damping",
        f"the policy was trained {'without' if drops else 'with'} the joint damping of the robot's model",
        set_fields(model_joint_damping="drop" if drops else "keep"),
    )


def rates(_: PolicyContract, __: RobotFacts) -> Iterator[Edit]:
    """Yield the other rates of a policy."""
    for rate in _RATES:
        text = f"the policy was trained at {rate:g} Hz"
        yield Edit(f"rate {rate:g} Hz", "rate", text, set_fields(policy_dt=1.0 / rate), RATE_DOUBT)


def _multiplied(names: tuple[str, ...], factor: float | FloatArray, contract: PolicyContract) -> PolicyContract:
    return replace(contract, **{name: getattr(contract, name) * factor for name in names})


def _scale_from_efforts(robot: RobotFacts, contract: PolicyContract) -> PolicyContract:
    stiffness, effort = contract.joint_stiffness, robot.effort_limit[_places(contract.joint_names, robot.joint_names)]
    for known, its_effort in _G1_EFFORTS.items():
        effort[np.isinf(effort) & np.isclose(stiffness, known, rtol=0.01)] = its_effort
    scale = np.round(_EFFORT_SHARE * effort / stiffness, 3)  # as it is written
    return replace(contract, action_scale=scale[_driven(contract)])  # refused if one is infinite


def _robot_values(robot: RobotFacts, values: Mapping[str, FloatArray], contract: PolicyContract) -> PolicyContract:
    """Set fields to values of the robot's joints, each of shape (n,)."""
    places = _places(contract.joint_names, robot.joint_names)
    own: dict[str, Any] = {name: value[places] for name, value in values.items()}
    return replace(contract, **own)


def _listed_orders(robot: RobotFacts) -> Mapping[str, tuple[str, ...]]:
    """Orders in which a file may list values, whatever the order of its names."""
    return {"the robot's": robot.joint_names, "breadth-first (Isaac)": robot.breadth_first}


def _listed(names: tuple[str, ...], order: tuple[str, ...], contract: PolicyContract) -> PolicyContract:
    """Return the contract with the values of some fields read as a list that follows `order`."""
    joints = contract.action_joint_names if names == ("action_scale",) else contract.joint_names
    places = _places(joints, tuple(name for name in order if name in joints))
    return replace(contract, **{name: getattr(contract, name)[places] for name in names})


def _posed(change: Change, contract: PolicyContract) -> PolicyContract:
    """Change the default pose. An action is relative to it unless the contract says otherwise: its offset moves too."""
    follows = np.array_equal(np.asarray(contract.action_offset), contract.default_joint_pos[_driven(contract)])
    return replace(change(contract), action_offset=None if follows else contract.action_offset)


def _driven(contract: PolicyContract) -> npt.NDArray[np.intp]:
    return _places(contract.action_joint_names, contract.joint_names)


def _places(joints: tuple[str, ...], order: tuple[str, ...]) -> npt.NDArray[np.intp]:
    """Return where each of `joints` is in a list that follows `order`."""
    return joint_indices(joints, order, "joints")
