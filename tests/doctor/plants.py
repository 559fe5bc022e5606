"""Fourteen single mistakes of wiring, planted into the right contracts of published policies."""

from collections.abc import Callable, Mapping
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
            term if term.joints is None else replace(term, joints=tuple(names[name] for name in term.joints))
            for term in contract.terms
        ]
        driven = tuple(names[name] for name in contract.action_joint_names)
        return replace(contract, observation=terms, joint_names=order, action_joint_names=driven)

    return plant


def swapped(one: str, other: str) -> Plant:
    def plant(contract: PolicyContract) -> PolicyContract:
        names = {one: other, other: one}
        return relabelled(tuple(names.get(name, name) for name in contract.joint_names))(contract)

    return plant


def turned(joint: str) -> Plant:
    """A joint that turns the other way on the robot."""

    def plant(contract: PolicyContract) -> PolicyContract:
        signs = np.where(np.array(contract.joint_names) == joint, -1.0, 1.0)
        terms = tuple(
            replace(term, scale=term.scale * signs) if term.kind in ("joint_pos", "joint_vel") else term
            for term in contract.terms
        )
        return replace(
            contract,
            observation=terms,
            action_scale=contract.action_scale * signs,
            default_joint_pos=contract.default_joint_pos * signs,
            action_offset=contract.action_offset * signs,
        )

    return plant


def term(name: str, **options: Any) -> Plant:
    def plant(contract: PolicyContract) -> PolicyContract:
        assert name in contract.observation_names
        terms = (replace(item, **options) if item.name == name else item for item in contract.terms)
        return replace(contract, observation=tuple(terms))

    return plant


def terms_swapped(one: str, other: str) -> Plant:
    def plant(contract: PolicyContract) -> PolicyContract:
        terms = {item.name: item for item in contract.terms}
        names = {one: other, other: one}
        return replace(contract, observation=tuple(terms[names.get(name, name)] for name in contract.observation_names))

    return plant


def multiplied(factor: float, *names: str) -> Plant:
    return lambda contract: replace(contract, **{name: getattr(contract, name) * factor for name in names})


def gains_listed(order: tuple[str, ...]) -> Plant:
    """Gains in the order of another list of the joints."""

    def plant(contract: PolicyContract) -> PolicyContract:
        places = [contract.joint_names.index(name) for name in order]
        return replace(
            contract,
            joint_stiffness=contract.joint_stiffness[places],
            joint_damping=contract.joint_damping[places],
        )

    return plant


def no_pose(contract: PolicyContract) -> PolicyContract:
    return replace(contract, default_joint_pos=np.zeros(len(contract.joint_names)), action_offset=None)


def at_rate(hertz: float) -> Plant:
    return lambda contract: replace(contract, policy_dt=1.0 / hertz)


def plants_of(policy: str, robot: tuple[str, ...], breadth_first: tuple[str, ...]) -> Mapping[str, Plant]:
    """The mistakes that a policy can have, by name; `robot` and `breadth_first` are orders of its joints."""
    pick: Mapping[str, tuple[Any, ...]] = {
        "unitree": (("left_hip_roll_joint", "left_hip_yaw_joint"), breadth_first, "left_knee_joint", "base_ang_vel",
                    ("joint_pos_rel", "joint_vel_rel"), "last_action", "projected_gravity", breadth_first),
        "waltz": (("left_knee_joint", "left_shoulder_pitch_joint"), robot, "right_hip_roll_joint", "base_ang_vel",
                  ("base_lin_vel", "base_ang_vel"), "actions", "", robot),
        "holosoma": (("left_hip_pitch_joint", "right_hip_pitch_joint"), breadth_first, "right_knee_joint",
                     "base_ang_vel", ("dof_pos", "dof_vel"), "actions", "projected_gravity", breadth_first),
        "berkeley": (("leg_left_hip_yaw_joint", "leg_left_hip_pitch_joint"), breadth_first,
                     "leg_right_knee_pitch_joint", "base_ang_vel", ("base_ang_vel", "projected_gravity"), "last_action",
                     "projected_gravity", ()),
        "playground": (("LL_HFE", "LL_KFE"), tuple(sorted(robot)), "LR_HAA", "base_ang_vel",
                       ("joint_pos", "joint_vel"), "actions", "projected_gravity", breadth_first),
    }  # fmt: skip
    pair, order, joint, gyro, terms, action, gravity, gains = pick[policy]
    plants: dict[str, Plant] = {
        "two joints swapped": swapped(*pair),
        "order of all joints": relabelled(order),
        "sign of a joint": turned(joint),
        "gains x 2": multiplied(2.0, "joint_stiffness", "joint_damping"),
        "action scale x 0.5": multiplied(0.5, "action_scale"),
        "default pose zero": no_pose,
        "gyro in the world frame": term(gyro, frame="world"),
        "25 Hz": at_rate(25.0),
        "two terms swapped": terms_swapped(*terms),
        "last action scaled": term(action, form="scaled"),
    }
    if gravity:
        plants["gravity sign"] = term(gravity, scale=-1.0)
    if policy == "waltz":
        plants["quaternion order"] = lambda contract: replace(contract, reference_quaternion="xyzw")
    if gains:
        plants["gains in another order"] = gains_listed(gains)
    return plants


def alike(one: PolicyContract, other: PolicyContract) -> bool:
    """Whether two contracts wire a policy alike, but for rounding."""
    a, b = wiring_values(one), wiring_values(other)
    return a.keys() == b.keys() and all(same(a[name], b[name]) for name in a)


def same(a: Any, b: Any) -> bool:
    is_numeric = np.array(a).dtype.kind == np.array(b).dtype.kind == "f"
    return bool(np.allclose(a, b)) if is_numeric else a == b
