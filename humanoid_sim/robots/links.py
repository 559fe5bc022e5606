"""A compiled model as a tree of links and joints, as URDF and `/tf` have it: one joint between two links.

A MuJoCo body may have several joints, each with an anchor of its own; here every joint has a link. A link's frame has
the axes of its body and stands at the joint's anchor; a body without joints is fixed to its parent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import multiply, rotate
from humanoid_sim.mit import FloatArray

JointKind = Literal["fixed", "revolute", "continuous", "prismatic", "floating"]
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
_ORIGIN = np.zeros(3)


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A link, and the joint that carries it."""

    name: str
    parent: str
    joint: str
    kind: JointKind
    position: FloatArray
    """Shape (3,), m: where the link is in its parent's frame while the joint is at 0."""
    quaternion: FloatArray
    """Shape (4,), w x y z, likewise."""
    axis: FloatArray
    """Shape (3,), of the joint, link frame."""
    body: int
    """Whose geoms it shows, in the model; -1 between the joints of a body."""
    shift: FloatArray
    """Shape (3,), m: the link's origin in its body's frame."""
    joint_id: int
    """In the model; -1 for a fixed one."""


def links_of(model: mujoco.MjModel) -> tuple[Link, ...]:
    """The links of a model, parents first; the first one's parent is the link `world`, which has no joint."""
    links: list[Link] = []
    names = {0: "world"}
    shifts = {0: _ORIGIN}
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        name = model.body(body).name or f"body_{body}"
        before, shift = names[parent], shifts[parent]
        position, quaternion = model.body_pos[body] - shift, np.array(model.body_quat[body])
        if not count:
            links.append(Link(name, before, f"{name}_fixed", "fixed", position, quaternion, _ORIGIN, body, _ORIGIN, -1))
            shift = _ORIGIN
        for joint in range(first, first + count):
            is_last = joint == first + count - 1
            joint_name = model.joint(joint).name or f"joint_{joint}"
            anchor = np.array(model.jnt_pos[joint])
            is_first = joint == first
            kind, moved, turned = _joint(model, joint)
            # The first joint stands where the body is in its parent's frame, a further one where it is in the body's.
            where = position + rotate(quaternion, anchor + moved) if is_first else anchor - shift + moved
            own = name if is_last else f"{name}_{joint_name}"
            links.append(
                Link(
                    own,
                    before,
                    joint_name,
                    kind,
                    where,
                    multiply(quaternion if is_first else _IDENTITY, turned),
                    np.array(model.jnt_axis[joint]),
                    body if is_last else -1,
                    anchor,
                    joint,
                )
            )
            before, shift = own, anchor
        names[body], shifts[body] = name, shift
    return tuple(links)


def _joint(model: mujoco.MjModel, joint: int) -> tuple[JointKind, FloatArray, FloatArray]:
    """Its kind, and how far it is moved, (3,) m and (4,) w x y z, at 0: its reference may be another value."""
    axis = np.array(model.jnt_axis[joint])
    kind = mujoco.mjtJoint(int(model.jnt_type[joint]))
    if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
        return "floating", _ORIGIN, _IDENTITY
    reference = float(model.qpos0[model.jnt_qposadr[joint]])
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        return "prismatic", -reference * axis, _IDENTITY
    half = -0.5 * reference
    turned = np.concatenate([[np.cos(half)], np.sin(half) * axis])
    return "revolute" if model.jnt_limited[joint] else "continuous", _ORIGIN, turned
