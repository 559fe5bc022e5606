"""Hypotheses about joints: all in another order, one the other way round, two with each other's place or gains."""

from __future__ import annotations

from collections.abc import Iterator
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
    STRONG_DOUBT,
    Edit,
    RobotFacts,
    change_terms,
    limb,
    mirrored,
    set_fields,
)


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
        yield Edit(f"{name}, values stay in place", cause, text, partial(_relabelled, order), is_whole=True)
        text = f"the policy sees and drives the joints in {title} order; gains, pose and scale belong to their joints"
        yield Edit(f"{name}, values move along", cause, text, partial(_reordered, order), is_whole=True)


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
            yield Edit(f"{name} turned round{which}", "joint direction", text, change, JOINT_DOUBT, True, True)


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
            yield Edit(f"{title} swapped", "joint order", text, change, JOINT_DOUBT, True, len(chosen) == 2)


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
                yield Edit(title, "gains of two joints", title, set_fields(**fields), STRONG_DOUBT, False, True)
