"""A URDF of a compiled MJCF: what viewers of recordings draw, with primitive geometry and no files beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import matrix, multiply, rotate
from humanoid_sim.messages import QPOS_DOCUMENT, URDF_DOCUMENT
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.guards import rated_speed
from humanoid_sim.robots.mjcf import bare_model

_Element = ElementTree.Element
_SHOWN_GROUPS = 3
"""Groups of geoms that MuJoCo's own viewer shows; those beyond are for contacts."""
_GIMBAL = 1e-12
_SPECK = 1e-9
"""kg and kg·m², of a link between the joints of one body: loaders with dynamics refuse a moving link without mass."""


def body_documents(description: RobotDescription) -> dict[str, str]:
    """Return what a recording's header says of the robot's body, for `humanoid_sim.recording.body`."""
    model = bare_model(description)
    return {URDF_DOCUMENT: urdf_of(model, description), QPOS_DOCUMENT: qpos_addresses(model)}


def qpos_addresses(model: mujoco.MjModel) -> str:
    """Return where the value of each joint begins in `qpos`, by the joint's name in the URDF, as JSON."""
    joints = [link for link in links_of(model) if link.joint_id >= 0]
    return json.dumps({link.joint: int(model.jnt_qposadr[link.joint_id]) for link in joints})


def urdf_of(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Return the robot as URDF: links, joints with their limits, inertia, and geoms as spheres, cylinders and boxes.

    A capsule is a cylinder and two spheres; a mesh or an ellipsoid is the box around it. Geoms that MuJoCo's viewer
    shows are `visual`, those that can collide are `collision`, and some are both. The IMU is a link of its own.
    A floating base hangs on the link `world` by a joint of type `floating`.
    """
    root = ElementTree.Element("robot", name=description.name)
    world = ElementTree.SubElement(root, "link", name="world")
    _add_geoms(world, model, 0, np.zeros(3))
    limits = {
        joint.name: (joint.lower, joint.upper, joint.effort_limit, speed)
        for joint, speed in zip(description.joints, rated_speed(description), strict=True)
    }
    links = links_of(model)
    for link in links:
        element = ElementTree.SubElement(root, "link", name=link.name)
        if link.body >= 0:
            _add_inertia(element, model, link)
            _add_geoms(element, model, link.body, link.shift)
        else:
            _inertial(element, _SPECK, np.full(3, _SPECK))
    for link in links:
        _add_joint(root, model, link, limits)
    _add_imu(root, model, description, links)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _add_joint(
    root: _Element, model: mujoco.MjModel, link: Link, limits: Mapping[str, tuple[float, float, float, float]]
) -> None:
    """Add a joint with the description's limits, or the model's; effort and velocity are 0 where they are not known."""
    joint = ElementTree.SubElement(root, "joint", name=link.joint, type=link.kind)
    ElementTree.SubElement(joint, "parent", link=link.parent)
    ElementTree.SubElement(joint, "child", link=link.name)
    _add_origin(joint, link.position, link.quaternion)
    if link.kind in ("revolute", "prismatic", "continuous"):
        ElementTree.SubElement(joint, "axis", xyz=_numbers(link.axis))
        lower, upper, *others = limits.get(link.joint, (*model.jnt_range[link.joint_id], 0.0, 0.0))
        effort, velocity = (_number(value if math.isfinite(value) else 0.0) for value in others)  # numbers are required
        bounds = {"effort": effort, "velocity": velocity}
        if link.kind != "continuous":
            bounds |= {"lower": _number(lower), "upper": _number(upper)}
        ElementTree.SubElement(joint, "limit", bounds)


def _add_imu(root: _Element, model: mujoco.MjModel, description: RobotDescription, links: tuple[Link, ...]) -> None:
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, description.imu)
    if site < 0 or description.imu in (link.name for link in links):
        return  # the IMU is a body
    body = int(model.site_bodyid[site])
    owner = next((link for link in links if link.body == body), None)
    shift = np.zeros(3) if owner is None else owner.shift
    ElementTree.SubElement(root, "link", name=description.imu)
    joint = ElementTree.SubElement(root, "joint", name=f"{description.imu}_fixed", type="fixed")
    ElementTree.SubElement(joint, "parent", link="world" if owner is None else owner.name)
    ElementTree.SubElement(joint, "child", link=description.imu)
    _add_origin(joint, model.site_pos[site] - shift, model.site_quat[site])


def _add_inertia(element: _Element, model: mujoco.MjModel, link: Link) -> None:
    mass = float(model.body_mass[link.body])
    if not mass:
        return
    inertial = _inertial(element, mass, model.body_inertia[link.body])
    _add_origin(inertial, model.body_ipos[link.body] - link.shift, model.body_iquat[link.body])


def _inertial(element: _Element, mass: float, inertia: FloatArray) -> _Element:
    """Add a mass in kg, and its principal moments of inertia (3,), kg·m²."""
    inertial = ElementTree.SubElement(element, "inertial")
    ElementTree.SubElement(inertial, "mass", value=_number(mass))
    xx, yy, zz = (_number(value) for value in inertia)
    ElementTree.SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy="0", ixz="0", iyz="0")
    return inertial


def _add_geoms(element: _Element, model: mujoco.MjModel, body: int, shift: FloatArray) -> None:
    first = int(model.body_geomadr[body])
    for geom in range(first, first + int(model.body_geomnum[body])):
        is_shown = model.geom_group[geom] < _SHOWN_GROUPS
        collides = bool(model.geom_contype[geom] | model.geom_conaffinity[geom])
        position, quaternion = model.geom_pos[geom] - shift, model.geom_quat[geom]
        for shape, attributes, offset in _shapes(model, geom):
            for tag in (*(("visual",) if is_shown else ()), *(("collision",) if collides else ())):
                part = ElementTree.SubElement(element, tag)
                _add_origin(part, position + matrix(quaternion) @ offset, quaternion)
                ElementTree.SubElement(ElementTree.SubElement(part, "geometry"), shape, attributes)
                if tag == "visual":
                    material = ElementTree.SubElement(part, "material", name=f"geom_{geom}")
                    ElementTree.SubElement(material, "color", rgba=_numbers(_colour(model, geom)))


def _shapes(model: mujoco.MjModel, geom: int) -> Iterator[tuple[str, dict[str, str], FloatArray]]:
    """Yield what a geom is made of: the tag, its attributes, and where it is in the geom's frame, (3,) m."""
    kind, (a, b, _) = mujoco.mjtGeom(int(model.geom_type[geom])), (float(value) for value in model.geom_size[geom])
    here = np.zeros(3)
    match kind:
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            yield "sphere", {"radius": _number(a)}, here
        case mujoco.mjtGeom.mjGEOM_CAPSULE | mujoco.mjtGeom.mjGEOM_CYLINDER:
            yield "cylinder", {"radius": _number(a), "length": _number(2.0 * b)}, here
            for end in (-b, b) if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else ():
                yield "sphere", {"radius": _number(a)}, np.array([0.0, 0.0, end])
        case mujoco.mjtGeom.mjGEOM_BOX | mujoco.mjtGeom.mjGEOM_ELLIPSOID | mujoco.mjtGeom.mjGEOM_MESH:
            yield "box", {"size": _numbers(2.0 * model.geom_aabb[geom, 3:])}, np.array(model.geom_aabb[geom, :3])
        case _:  # planes and height fields are the ground, not the robot
            return


def _colour(model: mujoco.MjModel, geom: int) -> FloatArray:
    material = int(model.geom_matid[geom])
    colour: FloatArray = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return colour


def _add_origin(element: _Element, position: FloatArray, quaternion: FloatArray) -> None:
    ElementTree.SubElement(element, "origin", xyz=_numbers(position), rpy=_numbers(_roll_pitch_yaw(quaternion)))


def _roll_pitch_yaw(quaternion: FloatArray) -> FloatArray:
    """Shape (3,), rad, about the fixed axes x, y, z in this order: URDF's."""
    rotation = matrix(np.asarray(quaternion, dtype=np.float64))
    level = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch = math.atan2(-rotation[2, 0], level)
    if level < _GIMBAL:  # roll and yaw turn about one axis
        return np.array([math.atan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    return np.array([math.atan2(rotation[2, 1], rotation[2, 2]), pitch, math.atan2(rotation[1, 0], rotation[0, 0])])


def _numbers(values: FloatArray) -> str:
    return " ".join(_number(float(value)) for value in values)


def _number(value: float) -> str:
    return repr(round(float(value), 12) + 0.0)


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
    """Body of the model whose geoms it shows; -1 between the joints of a body."""
    shift: FloatArray
    """Shape (3,), m: the link's origin in its body's frame."""
    joint_id: int
    """In the model; -1 for a fixed one."""


def links_of(model: mujoco.MjModel) -> tuple[Link, ...]:
    """Return the links of a model, parents first; the first one's parent is the link `world`, which has no joint.

    A MuJoCo body may have several joints, each with an anchor of its own; here every joint has a link, as URDF and
    `/tf` have it. A link's frame has the axes of its body and stands at the joint's anchor; a body without joints is
    fixed to its parent.
    """
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
