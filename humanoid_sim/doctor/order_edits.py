"""Hypotheses about orders: of joints, of terms, of a history's steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import FORMS, PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.term_kinds import TERM_KINDS
from humanoid_sim.controllers.terms import HistoryOrder, Term
from humanoid_sim.doctor.edits import Edit, RobotFacts, change_terms, mirrored, set_fields


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
        yield Edit(f"{name}, values stay in place", cause, text, partial(relabelled, order), is_whole=True)
        text = f"the policy sees and drives the joints in {title} order; gains, pose and scale belong to their joints"
        yield Edit(f"{name}, values move along", cause, text, partial(_reordered, order), is_whole=True)


def relabelled(order: tuple[str, ...], contract: PolicyContract) -> PolicyContract:
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


def term_orders(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield other orders of the terms, and the last two or three in each other's places."""
    terms = contract.terms
    listed = list(TERM_KINDS)  # in the order of legged_gym and Isaac Lab
    places = {term.name: listed.index(contract.kind(term).name) for term in terms if contract.kind(term).name in listed}
    orders = {
        "alphabetical": tuple(sorted(terms, key=lambda term: term.name)),
        "as task configurations list them": tuple(sorted(terms, key=lambda term: places.get(term.name, len(listed)))),
        "reversed": terms[::-1],
    }
    for title, order in orders.items():
        text = f"the observation's terms are {title}: {', '.join(term.name for term in order)}"
        yield Edit(f"terms {title}", "term order", text, partial(_listed_terms, order))
    for i, (one, other) in enumerate(pairwise(terms)):
        text = f"{other.name} comes before {one.name} in the observation"
        order = (*terms[:i], other, one, *terms[i + 2 :])
        yield Edit(f"terms {one.name} and {other.name} swapped", "term order", text, partial(_listed_terms, order))


def _listed_terms(order: tuple[Term, ...], contract: PolicyContract) -> PolicyContract:
    """Sort the terms as these are, whatever else has been changed about them."""
    terms = {term.name: term for term in contract.terms}
    return replace(contract, observation=tuple(terms[term.name] for term in order))


def history_orders(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield histories whose steps are the other way round, or laid out step by step instead of term by term."""
    if all(term.history == 1 for term in contract.terms):
        return
    flip: dict[HistoryOrder, HistoryOrder] = {"oldest_first": "newest_first", "newest_first": "oldest_first"}
    order = flip[contract.terms[0].history_order].replace("_", " ")

    def flipped(contract: PolicyContract) -> PolicyContract:
        return change_terms(contract, lambda term: replace(term, history_order=flip[term.history_order]))

    text = f"the steps of a term's history are {order}"
    yield Edit(f"history {order}", "history order", text, flipped, is_whole=True)
    name, text, layout = "history per step", "each step's terms lie together", "per_step"
    if contract.history_layout == "per_step":
        name, text, layout = "history per term", "each term's steps lie together", "per_term"
    yield Edit(name, "history layout", text, set_fields(history_layout=layout))
