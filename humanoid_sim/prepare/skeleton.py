"""The robot as a tree of bodies and hinges: what orders its joints and bodies may come in, and how they turn."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import base_body, build_model

__all__ = ["Hinge", "Link", "Skeleton", "match_names", "named_order"]

OrderName = Literal["contract", "robot", "mjcf", "breadth_first"]


@dataclass(frozen=True, slots=True, eq=False)
class Hinge:
    """A hinge joint."""

    name: str
    axis: FloatArray
    """Shape (3,), unit vector in the body's frame."""
    zero: float
    """rad, its value in the model's reference pose."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A body below the base."""

    name: str
    parent: str
    rotation: FloatArray
    """Shape (3, 3), of the body in its parent where its joints are at `zero`."""
    hinges: tuple[Hinge, ...]
    """In the order in which they turn the body."""


class Skeleton:
    """Names and geometry of a robot's bodies, in MJCF order, from the base on."""

    def __init__(self, description: RobotDescription) -> None:
        """Build the model.

        Raises:
            InputError: if the robot's MJCF cannot be read.
        """
        model = build_model(description, scene=False)
        base = base_body(model, description)
        self.base: str = model.body(base).name
        self.joints = description.joint_names
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self.base_position: FloatArray = data.xpos[base].copy()
        """Shape (3,), m, world frame, where the model has it."""
        self.base_quaternion: FloatArray = data.xquat[base].copy()
        """Shape (4,), w x y z."""
        self._model = model
        members = [base]
        for body in range(base + 1, model.nbody):
            if int(model.body_parentid[body]) in members:
                members.append(body)
        self._members = members
        self.bodies: tuple[str, ...] = tuple(model.body(body).name for body in members)
        self.links: Mapping[str, Link] = {
            link.name: link for link in (self._link(body) for body in members if body != base)
        }

    def _link(self, body: int) -> Link:
        model = self._model
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.body_quat[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        hinges = tuple(
            Hinge(model.joint(j).name, model.jnt_axis[j].copy(), float(model.qpos0[model.jnt_qposadr[j]]))
            for j in range(first, first + count)
            if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
        )
        return Link(model.body(body).name, model.body(model.body_parentid[body]).name, rotation.reshape(3, 3), hinges)

    def body_order(self, name: Literal["mjcf", "breadth_first"]) -> tuple[str, ...]:
        """All bodies, depth first as the MJCF and mjlab have them, or breadth first as Isaac does."""
        return self.bodies if name == "mjcf" else tuple(self._model.body(body).name for body in self._breadth_first())

    def joint_order(self, name: Literal["robot", "mjcf", "breadth_first"]) -> tuple[str, ...]:
        """The robot's joints in its description's order, in that of the MJCF, or breadth first."""
        if name == "robot":
            return self.joints
        found = []
        for body in self._members if name == "mjcf" else self._breadth_first():
            first, count = int(self._model.body_jntadr[body]), int(self._model.body_jntnum[body])
            found += [self._model.joint(j).name for j in range(first, first + count)]
        return tuple(joint for joint in found if joint in self.joints)

    def _breadth_first(self) -> list[int]:
        depth = {self._members[0]: 0}
        for body in self._members[1:]:
            depth[body] = depth[int(self._model.body_parentid[body])] + 1
        # Among bodies of the same depth the children of the first come first: the MJCF's own order. The sort is stable.
        return sorted(self._members, key=lambda body: depth[body])


def named_order(option: str, value: str, known: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """What an option such as --joint-order stands for: one of the known orders, or the names themselves.

    Raises:
        InputError: if it is neither.
    """
    if value in known:
        return known[value]
    names = tuple(name.strip() for name in value.split(","))
    if len(names) < 2 or not all(names):
        raise InputError(f"{option}: is '{value}', expected {', '.join(known)}, or names separated by commas")
    return names


def match_names(source: str, what: str, names: Iterable[str], wanted: Iterable[str], who: str) -> list[int]:
    """Places of the `wanted` names among `names`.

    Raises:
        InputError: naming the one that is missing and those that exist.
    """
    listed = list(names)
    for name in wanted:
        if name not in listed:
            raise InputError(f"{source}: {known_names(what, name, listed)} ({who} needs it)")
    return [listed.index(name) for name in wanted]
