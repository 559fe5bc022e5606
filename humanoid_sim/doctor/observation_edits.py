"""Hypotheses about the observation's terms: order, signs, scales, frames, conventions, history, zeros."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.term_kinds import TERM_KINDS
from humanoid_sim.controllers.terms import HistoryOrder, Term
from humanoid_sim.doctor.edits import (
    STRONG_DOUBT,
    Edit,
    RobotFacts,
    change_terms,
    set_fields,
    set_options,
    term_edit,
    terms_with,
)
from humanoid_sim.mit import BASE, IMU

_LEGGED_GYM: Mapping[str, float] = {"base_ang_vel": 0.25, "joint_vel": 0.05}
"""Scales of legged_gym, kept by many of its descendants."""
_LEGGED_GYM_COMMANDS: Mapping[str, float | tuple[float, ...]] = {
    "base_lin_vel": 2.0,
    "velocity_command": (2.0, 2.0, 0.25),
    "command_lin_vel": 2.0,
    "command_ang_vel": 0.25,
}
_LAYOUTS = {
    "rows": "first two columns, row by row",
    "columns": "first two columns, one after the other",
    "two_rows": "first two rows",
}
_PERIODS = (0.6, 0.8, 1.0)
"""s of a gait cycle, seen in the wild."""


def _is_zero(term: Term) -> bool:
    return not np.any(term.scale)


def zeroed(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield terms that are fed in earnest instead of as zeros, and the other way round."""
    for term in contract.terms:
        if not _is_zero(term):
            yield term_edit(term, " fed as zeros", "zeroed", f"the policy was trained with {term.name} zero", scale=0.0)
            continue
        text = f"{term.name} is not zero: the policy was trained with it"
        for scale in contract.kind(term).scales:
            title = " fed" + (f", scaled by {scale:g}" if scale != 1.0 else "")
            yield term_edit(term, title, "zeroed", text, scale=scale)


def scales(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield other scales of the observation: all 1, those of legged_gym, or one term's alone."""
    together: dict[str, Mapping[str, float | tuple[float, ...]]] = {
        "all 1": {},
        "of legged_gym (ang vel 0.25, joint vel 0.05)": _LEGGED_GYM,
        "of legged_gym, commands too": {**_LEGGED_GYM, **_LEGGED_GYM_COMMANDS},
    }
    for title, values in together.items():
        text = f"the observation's scales are {title}"
        yield Edit(f"observation scales {title}", "observation scales", text, partial(_scaled, values))
    for term in contract.terms:
        for scale in () if _is_zero(term) else contract.kind(term).scales:
            text = f"{term.name} is multiplied by {scale:g}"
            yield term_edit(term, f" scaled by {scale:g}", "scale", text, scale=scale)


def _scaled(values: Mapping[str, float | tuple[float, ...]], contract: PolicyContract) -> PolicyContract:
    """Scale by the kind of a term; those without a value by 1, those that are fed as zeros not at all."""

    def scaled(term: Term) -> Term:
        scale = np.asarray(values.get(contract.kind(term).name, 1.0))
        return term if _is_zero(term) else replace(term, scale=scale)

    return change_terms(contract, scaled)


def conventions(contract: PolicyContract, robot: RobotFacts) -> Iterator[Edit]:
    """Signs, frames, quaternion order, and what joint positions and the last action are relative to."""
    for term in terms_with(contract, "sign"):
        text = f"{term.name} points the other way when the robot stands upright"
        yield term_edit(term, " sign flipped", "sign", text, scale=-np.asarray(term.scale))
    for term in terms_with(contract, "frame"):
        (other,) = term.others("frame")
        text = f"{term.name} is given in the {other} frame"
        yield term_edit(term, f" in the {other} frame", "frame", text, frame=other)
    points = {BASE: "the base's origin", IMU: "the IMU", **{site: f"the site '{site}'" for site in robot.points}}
    for term in terms_with(contract, "at"):
        for other, point in points.items():
            if other != term.at:
                yield term_edit(term, f" at {point}", "point", f"{term.name} is the velocity of {point}", at=other)
    for term in terms_with(contract, "quaternion"):
        (other,) = term.others("quaternion")
        order = " ".join(other)
        yield term_edit(term, f" {order}", "order", f"{term.name} is ordered {order}", quaternion=other)
    for term in terms_with(contract, "relative"):
        is_relative = contract.kind(term).is_relative(term)
        title = " absolute" if is_relative else " less the default pose"
        text = f"positions in {term.name} are {'the angles themselves' if is_relative else 'less the default pose'}"
        yield term_edit(term, title, "relative", text, relative=not is_relative)
    for term in terms_with(contract, "form"):
        (other,) = term.others("form")
        what = "times the action scale" if other == "scaled" else "as it is"
        yield term_edit(term, f" {other}", "form", f"{term.name} is the network's output {what}", form=other)


def imu_turns(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield turns of the IMU by a quarter and by half: all its vectors are turned."""
    shown = [term for term in terms_with(contract, "axes") if term.frame == "body"]
    if len({term.axes for term in shown}) != 1:
        return
    names = {term.name for term in shown}
    for axes in shown[0].others("axes"):
        text = f"the IMU is turned: what the policy knows as x y z are its axes {axes}"
        yield Edit(f"IMU turned: {axes}", "IMU axes", text, partial(set_options, names, axes=axes))


def phases(contract: PolicyContract, _: RobotFacts) -> Iterator[Edit]:
    """Yield gait clocks that start with the other foot, show the step before, or run at another pace."""
    rule = contract.phase
    if rule is None or not contract.requires("phase"):
        return
    starts = {
        "from the other foot": replace(rule, offsets=rule.offsets[::-1]),
        f"{'not ' if rule.advance_first else ''}advanced before the first observation": replace(
            rule, advance_first=not rule.advance_first
        ),
    }
    for title, changed in starts.items():
        name = f"gait clock {title}"
        yield Edit(name, "gait clock start", f"phase: {name}", set_fields(phase=changed))
    for period in _PERIODS if rule.period is not None else ():
        name, change = f"gait period {period:g} s", set_fields(phase=replace(rule, period=period))
        yield Edit(name, "gait period", f"phase: {name}", change, STRONG_DOUBT)


def reference_conventions(contract: PolicyContract, robot: RobotFacts) -> Iterator[Edit]:
    """Yield what the motion reference's terms may mean, and how the reference may be laid onto the robot."""
    for term in terms_with(contract, "layout"):
        for layout, title in _LAYOUTS.items():
            text = f"{term.name} holds the rotation matrix's {title}"
            yield term_edit(term, f": {title}", "layout", text, layout=layout)
    for term in terms_with(contract, "inverse"):
        title = " forward" if term.inverse else " inverted"
        seen = "reference seen from the robot" if term.inverse else "robot seen from the reference"
        yield term_edit(term, title, "direction", f"{term.name} is the {seen}", inverse=not term.inverse)
    if not contract.requires("anchor_body"):
        return
    for body in robot.motion_bodies:
        text = f"the anchor terms compare {body}"
        yield Edit(f"anchor body {body}", "anchor body", text, set_fields(anchor_body=body))
    name, text = "reference aligned", "the reference is turned to the robot's heading at the start"
    if contract.align_reference:
        name, text = "reference not aligned", "the reference stays in its own world frame"
    yield Edit(name, "reference alignment", text, set_fields(align_reference=not contract.align_reference))
    other = "xyzw" if contract.reference_quaternion == "wxyz" else "wxyz"
    name, text = f"reference quaternions {' '.join(other)}", f"the motion's quaternions are ordered {' '.join(other)}"
    yield Edit(name, "reference quaternion order", text, set_fields(reference_quaternion=other))


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
    yield Edit(f"history {order}", "history order", text, flipped)
    name, text, layout = "history per step", "each step's terms lie together", "per_step"
    if contract.history_layout == "per_step":
        name, text, layout = "history per term", "each term's steps lie together", "per_term"
    yield Edit(name, "history layout", text, set_fields(history_layout=layout))
