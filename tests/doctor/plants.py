"""Single mistakes of wiring, to be planted into a right contract."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.edits import wiring_values

Plant = Callable[[PolicyContract], PolicyContract]


def relabelled(order: tuple[str, ...]) -> Plant:
    """Joint names listed in another order than the values and the network have."""

    def plant(contract: PolicyContract) -> PolicyContract:
        names = dict(zip(contract.joint_names, order, strict=True))
        terms = [
            item if item.joints is None else replace(item, joints=[names[joint] for joint in item.joints])
            for item in contract.terms
        ]
        driven = tuple(names[name] for name in contract.action_joint_names)
        return replace(contract, observation=terms, joint_names=order, action_joint_names=driven)

    return plant


def swapped(one: str, other: str) -> Plant:
    names = {one: other, other: one}
    return lambda contract: relabelled(tuple(names.get(name, name) for name in contract.joint_names))(contract)


def turned(joint: str) -> Plant:
    """A joint that turns the other way on the robot."""

    def plant(contract: PolicyContract) -> PolicyContract:
        signs = np.where(np.array(contract.joint_names) == joint, -1.0, 1.0)
        wrong = contract
        for item in contract.terms:
            if item.kind in ("joint_pos", "joint_vel"):
                wrong = term(item.name, scale=item.scale * signs)(wrong)
        names = ("action_scale", "default_joint_pos", "action_offset")
        return multiplied(signs, *names)(wrong)

    return plant


def term(name: str, **options: Any) -> Plant:
    def plant(contract: PolicyContract) -> PolicyContract:
        assert name in contract.observation_names
        terms = [replace(item, **options) if item.name == name else item for item in contract.terms]
        return replace(contract, observation=terms)

    return plant


def terms_swapped(one: str, other: str) -> Plant:
    names = {one: other, other: one}

    def plant(contract: PolicyContract) -> PolicyContract:
        terms = {item.name: item for item in contract.terms}
        return replace(contract, observation=[terms[names.get(name, name)] for name in terms])

    return plant


def multiplied(factor: Any, *names: str) -> Plant:
    return lambda contract: replace(contract, **{name: getattr(contract, name) * factor for name in names})


def gains_listed(order: tuple[str, ...]) -> Plant:
    """Gains in the order of another list of the joints."""

    def plant(contract: PolicyContract) -> PolicyContract:
        places = [contract.joint_names.index(name) for name in order]
        gains = {name: getattr(contract, name)[places] for name in ("joint_stiffness", "joint_damping")}
        return replace(contract, **gains)

    return plant


def no_pose(contract: PolicyContract) -> PolicyContract:
    return replace(contract, default_joint_pos=np.zeros(len(contract.joint_names)), action_offset=None)


def at_rate(hertz: float) -> Plant:
    return lambda contract: replace(contract, policy_dt=1.0 / hertz)


def alike(one: PolicyContract, other: PolicyContract) -> bool:
    """Whether two contracts wire a policy alike, but for rounding."""
    a, b = wiring_values(one), wiring_values(other)
    if a.keys() != b.keys():
        return False
    is_numeric = {name: np.array(a[name]).dtype.kind == np.array(b[name]).dtype.kind == "f" for name in a}
    return all(np.allclose(a[name], b[name]) if is_numeric[name] else a[name] == b[name] for name in a)
