"""Fields that follow from others: what no source has to say, because it can be worked out."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import FORMS
from humanoid_sim.controllers.term_kinds import TermKind, term_kind
from humanoid_sim.errors import FieldError, InputError, known_names
from humanoid_sim.policy.readers.partial import Given, derived, from_robot, is_assumed, is_from_robot


class IncompleteContractError(InputError):
    """No source gives some fields that a contract cannot do without."""

    def __init__(
        self,
        message: str,
        missing: tuple[str, ...],
        known: Mapping[str, Given],
        terms: Mapping[str, Mapping[str, Given]],
    ) -> None:
        super().__init__(message)
        self.missing = missing
        self.known = known
        """By its name every field that is known, as `PartialContract.fields` has them."""
        self.terms = terms
        """Options of the observation terms, by the names in the observation."""


class UnnamedJointsError(InputError):
    """Joints are given by their places on a robot, and no robot is known."""

    def __init__(self, count: int, message: str) -> None:
        super().__init__(message)
        self.count = count
        """Joints that such a robot has at least; 0 where nothing tells."""


class UnnamedRobot(tuple[str, ...]):
    """Joints of a robot that nobody has named, called by their places."""

    __slots__ = ()

    @classmethod
    def with_joints(cls, count: int) -> UnnamedRobot:
        """Return the joints of a robot that has so many."""
        return cls(f"joint {place} of the robot" for place in range(count))


def complete(
    known: dict[str, Given], terms: Mapping[str, dict[str, Given]], robot_joints: tuple[str, ...] | None
) -> None:
    """Add what follows from the fields that are known, and turn places of joints into names.

    Raises `FieldError` if a place leads nowhere.

    Args:
        known: changed in place; the three kinds of places are taken out of it.
        terms: options of the observation terms, changed in place.
    """
    places, named = known.pop("joint_places", None), known.pop("joint_patterns", None)
    # Without gains, the robot's own order has nothing to be the order of.
    if "joint_names" not in known and places and (places.value != slice(None) or "joint_stiffness" in known):
        known["joint_names"] = _joint_names(known, places, robot_joints)
    chosen, patterns = known.pop("action_joint_places", None), known.pop("action_joint_patterns", None)
    if isinstance(robot_joints, UnnamedRobot):  # no pattern of names fits it
        patterns = named = None
    if "joint_names" in known:
        joints: tuple[str, ...] = known["joint_names"].value
        _by_joint(known, joints)
        if named is not None and is_from_robot(known["joint_names"].source):
            _refuse_another_robot(joints, named)
        if "action_joint_names" not in known:
            known["action_joint_names"] = _action_joints(joints, chosen, patterns)
        for name, options in terms.items():
            if "joint_places" in options:
                given = options.pop("joint_places")
                options.setdefault("joints", Given(_at_places(joints, given, f"observation.{name}"), given.source))
    if "observation" in known:
        _complete_task(known, _kinds(known, terms))
    if "default_joint_pos" in known and "action_offset" not in known:
        known["action_offset"] = derived(None, "default_joint_pos")


def _by_joint(known: dict[str, Given], joints: tuple[str, ...]) -> None:
    """Values that are given by the names of joints, in the order of the joints; joints left out have no limit."""
    for name, form in FORMS.items():
        given = known.get(name)
        if form.kind != "limits" or given is None or not isinstance(given.value, dict):
            continue
        strangers = [joint for joint in given.value if joint not in joints]
        if strangers:
            raise FieldError(f"{known_names(f'joint in {name}', strangers[0], joints)} ({given.source})")
        known[name] = Given(np.array([given.value.get(joint, np.inf) for joint in joints]), given.source)


def missing_fields(known: Mapping[str, Given], terms: Mapping[str, Mapping[str, Given]]) -> list[str]:
    """Return the fields that a contract cannot do without, and that nobody gives."""
    missing = [name for name, form in FORMS.items() if form.is_required and name not in known]
    required = {kind.requires for kind in _kinds(known, terms)}
    missing += [name for name in FORMS if name in required and name not in known]
    if "phase" in missing and any(name.startswith("phase.") for name in known):
        missing.remove("phase")
        if "phase.period" not in known and "phase.frequency" not in known:
            missing.append("phase.period")
    if "observation" in known and "command" in known["observation"].value and not _value(known, "command_names"):
        missing.append("command_names")
    return missing


def _value(known: Mapping[str, Given], name: str) -> Any:
    return known[name].value if name in known else None


def _kinds(known: Mapping[str, Given], terms: Mapping[str, Mapping[str, Given]]) -> list[TermKind]:
    """Return what the terms of the observation mean, by their option `kind` or else by their names."""
    commands = _value(known, "command_names") or ()
    kinds = []
    for name in _value(known, "observation") or ():
        stated = terms.get(name, {}).get("kind")
        kinds.append(term_kind(name if stated is None else stated.value, commands))
    return kinds


def _complete_task(known: dict[str, Given], kinds: list[TermKind]) -> None:
    tasks = {kind.task for kind in kinds}
    task = "tracking" if "tracking" in tasks else "piano" if "piano" in tasks else "locomotion"
    quaternion = known.get("reference_quaternion")
    if task != "tracking" and quaternion is not None and is_assumed(quaternion.source):
        # Of no meaning without a motion; an assumption about it would only make noise.
        del known["reference_quaternion"]
    known.setdefault("task_type", derived(task, "the observation"))
    known.setdefault("command_names", derived((), "the observation"))
    if not any(kind.requires == "body_names" for kind in kinds):
        known.setdefault("body_names", derived((), "the observation"))


def _joint_names(known: Mapping[str, Given], places: Given, robot_joints: tuple[str, ...] | None) -> Given:
    if robot_joints is None:
        size = np.size(known["joint_stiffness"].value) if "joint_stiffness" in known else 0
        raise UnnamedJointsError(
            1 + max(places.value) if isinstance(places.value, tuple) else size,
            f"joint_names: {places.source} gives the joints by their places on the robot, and no robot is known; "
            "name the robot, or give joint_names in x.contract.yaml",
        )
    if isinstance(places.value, slice):
        return from_robot(robot_joints[places.value])
    order: tuple[int, ...] = places.value
    if len(order) == len(robot_joints):  # also where the numbers leave gaps for joints that this robot lacks
        ranks = sorted(order)
        return from_robot(tuple(robot_joints[ranks.index(place)] for place in order), places.source)
    if max(order) >= len(robot_joints):
        raise FieldError(
            f"joint_ids_map: leads to place {max(order)} ({places.source}), "
            f"but the robot has {len(robot_joints)} joints"
        )
    return from_robot(tuple(robot_joints[place] for place in order), places.source)


def _action_joints(joints: tuple[str, ...], chosen: Given | None, patterns: Given | None) -> Given:
    if chosen is not None:
        return Given(_at_places(joints, chosen, "actions.JointPositionAction.joint_ids"), chosen.source)
    if patterns is not None:
        matches = tuple(joint for joint in joints if any(_matches(text, joint, patterns) for text in patterns.value))
        if not matches:
            raise FieldError(f"action_joint_names: {list(patterns.value)} ({patterns.source}) matches no joint")
        return Given(matches, patterns.source)
    return derived(joints, "joint_names")


def _refuse_another_robot(joints: tuple[str, ...], named: Given) -> None:
    """Joints that are given by their places may be any robot's; where the source names some, they have to be there."""
    for pattern in named.value:
        if not any(_matches(pattern, joint, named) for joint in joints):
            raise FieldError(
                f"joint_names: {named.source} names '{pattern}', and no joint of this robot is called so: "
                f"is the policy for another robot? this one has {', '.join(joints)}"
            )


def _matches(pattern: str, joint: str, patterns: Given) -> bool:
    try:
        return re.fullmatch(pattern, joint) is not None
    except (re.error, RecursionError, OverflowError):
        raise FieldError(f"action_joint_names: {pattern!r} ({patterns.source}) is not a pattern") from None


def _at_places(joints: tuple[str, ...], places: Given, field: str) -> tuple[str, ...]:
    if isinstance(places.value, slice):
        return joints[places.value]
    if max(places.value) >= len(joints):
        raise FieldError(f"{field}: place {max(places.value)} ({places.source}), but there are {len(joints)} joints")
    return tuple(joints[place] for place in places.value)
