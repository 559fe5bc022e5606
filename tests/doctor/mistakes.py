"""The deliberate mistakes that the READMEs of the published policies measured, as edits of the right contract.

Shared by the tests of the doctor, for which they are the test set, and by closed-loop tests.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract

MJCF_JOINTS = tuple(
    f"{name}_joint"
    for name in (
        *(f"{side}_{joint}" for side in ("left", "right") for joint in (
            "hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll",
        )),
        "waist_yaw", "waist_roll", "waist_pitch",
        *(f"{side}_{joint}" for side in ("left", "right") for joint in (
            "shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw",
        )),
    )
)  # fmt: skip
"""The G1's 29 joints in the order of its MJCF."""

HOLOSOMA_LISTED = (
    "base_ang_vel", "projected_gravity", "command_lin_vel", "command_ang_vel", "dof_pos", "dof_vel", "actions",
    "sin_phase", "cos_phase",
)  # fmt: skip
"""Holosoma's observation terms as its configuration lists them."""

Edit = Callable[[PolicyContract], PolicyContract]


@dataclass(frozen=True)
class Mistake:
    """One row of a README's table of deliberate mistakes."""

    policy: str
    """Name in `published_policies`."""
    name: str
    edit: Edit
    """From the right contract to the wrong one."""
    cause: str
    """What the doctor calls it."""
    lost_at: float = math.inf
    """s, as the README measured it; infinite where the run completes."""
    leaves_band: bool = True
    """Whether a run that completes is told from a right one by its figures."""

    @property
    def loses(self) -> bool:
        """Whether the robot falls, or loses its motion, within the README's run."""
        return math.isfinite(self.lost_at)


def term(name: str, **options: Any) -> Edit:
    def edit(contract: PolicyContract) -> PolicyContract:
        assert name in contract.observation_names
        terms = (replace(term, **options) if term.name == name else term for term in contract.terms)
        return replace(contract, observation=tuple(terms))

    return edit


def fields(**values: Any) -> Edit:
    return lambda contract: replace(contract, **values)


def listed_terms(contract: PolicyContract) -> PolicyContract:
    terms = {term.name: term for term in contract.terms}
    return replace(contract, observation=tuple(terms[name] for name in HOLOSOMA_LISTED))


def scales_one(contract: PolicyContract) -> PolicyContract:
    return replace(contract, observation=tuple(replace(term, scale=1.0) for term in contract.terms))


def action_scale_one(contract: PolicyContract) -> PolicyContract:
    return replace(contract, action_scale=np.ones(contract.action_count))


def gravity_flipped(contract: PolicyContract) -> PolicyContract:
    return term("projected_gravity", scale=-1.0)(contract)


mjcf_order = fields(joint_names=MJCF_JOINTS, action_joint_names=MJCF_JOINTS)
orientation = partial(term, "motion_anchor_ori_b")

MISTAKES = (
    Mistake("unitree", "projected_gravity sign flipped", gravity_flipped, "projected_gravity sign", 0.68),
    Mistake("unitree", "base_ang_vel zero", term("base_ang_vel", scale=0.0), "base_ang_vel zeroed", 2.64),
    Mistake("unitree", "joint_pos not relative", term("joint_pos_rel", relative=False), "joint_pos_rel relative", 1.40),
    Mistake("unitree", "joint_vel zero", term("joint_vel_rel", scale=0.0), "joint_vel_rel zeroed"),
    Mistake("unitree", "last_action zero", term("last_action", scale=0.0), "last_action zeroed", 1.26),
    Mistake("unitree", "last_action scaled", term("last_action", form="scaled"), "last_action form"),
    Mistake("waltz", "MJCF joint order used", mjcf_order, "joint order", 0.10),
    Mistake("waltz", "base_ang_vel in world frame", term("base_ang_vel", frame="world"), "base_ang_vel frame", 0.88),
    Mistake("waltz", "reference not yaw-aligned", fields(align_reference=False), "reference alignment"),
    Mistake(
        "waltz", "two rows instead of two columns", orientation(layout="two_rows"), "motion_anchor_ori_b layout", 0.40
    ),
    Mistake(
        "waltz", "columns flattened column-major", orientation(layout="columns"), "motion_anchor_ori_b layout", 0.46
    ),
    Mistake("waltz", "inverse relative rotation", orientation(inverse=True), "motion_anchor_ori_b direction", 1.56),
    Mistake("waltz", "last action zero", term("actions", scale=0.0), "actions zeroed", 1.02),
    Mistake("waltz", "last action scaled", term("actions", form="scaled"), "actions form", 1.28),
    Mistake("waltz", "command relative to default pose", term("command", relative=True), "command relative", 0.84),
    Mistake("waltz", "action scale 1", action_scale_one, "action scale", 1.30),
    Mistake("waltz", "pelvis as anchor", fields(anchor_body="pelvis"), "anchor body", 7.20),
    Mistake("waltz", "base_lin_vel in world frame", term("base_lin_vel", frame="world"), "base_lin_vel frame", 7.04),
    Mistake("waltz", "base_lin_vel zero", term("base_lin_vel", scale=0.0), "base_lin_vel zeroed"),
    Mistake(
        "waltz",
        "motion_anchor_pos_b in world frame",
        term("motion_anchor_pos_b", frame="world"),
        "motion_anchor_pos_b frame",
        13.90,
    ),
    Mistake("waltz", "motion_anchor_pos_b zero", term("motion_anchor_pos_b", scale=0.0), "motion_anchor_pos_b zeroed"),
    Mistake("holosoma", "terms in listed order instead of alphabetical", listed_terms, "term order", 0.12),
    Mistake("holosoma", "obs scales all 1", scales_one, "observation scales", 0.10),
    Mistake("holosoma", "action scale 1", action_scale_one, "action scale", 0.50),
)


def turned_round(*joints: str) -> Edit:
    """Joints that turn the other way on the robot: its angles, speeds and commands have the other sign."""

    def edit(contract: PolicyContract) -> PolicyContract:
        signs = np.array([-1.0 if name in joints else 1.0 for name in contract.joint_names])
        assert (signs < 0.0).sum() == len(joints)
        assert contract.action_joint_names == contract.joint_names
        terms = tuple(
            replace(item, scale=item.scale * signs) if item.kind in ("joint_pos", "joint_vel") else item
            for item in contract.terms
        )
        return replace(
            contract,
            observation=terms,
            action_scale=contract.action_scale * signs,
            default_joint_pos=contract.default_joint_pos * signs,
            action_offset=contract.action_offset * signs,
        )

    return edit


def imu_axes(axes: str) -> Edit:
    """An IMU that is mounted another way round."""

    def edit(contract: PolicyContract) -> PolicyContract:
        kinds = ("base_ang_vel", "projected_gravity", "base_lin_vel")
        terms = (replace(item, axes=axes) if item.kind in kinds else item for item in contract.terms)
        return replace(contract, observation=tuple(terms))

    return edit


def sides_swapped(left: str, right: str) -> Edit:
    def edit(contract: PolicyContract) -> PolicyContract:
        def other(name: str) -> str:
            return name.replace(left, right) if left in name else name.replace(right, left)

        names = tuple(other(name) for name in contract.joint_names)
        assert names != contract.joint_names
        return replace(contract, joint_names=names, action_joint_names=names)

    return edit


def gains_swapped(one: str, other: str) -> Edit:
    def edit(contract: PolicyContract) -> PolicyContract:
        order = np.arange(len(contract.joint_names))
        i, j = contract.joint_names.index(one), contract.joint_names.index(other)
        order[[i, j]] = j, i
        assert contract.joint_stiffness[i] != contract.joint_stiffness[j]
        return replace(
            contract, joint_stiffness=contract.joint_stiffness[order], joint_damping=contract.joint_damping[order]
        )

    return edit
