"""URDF: written of a compiled MJCF for viewers, with primitive geometry and no files; and read into an MJCF."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import conjugate, matrix, multiply, rotate, rotate_inverse
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.messages import QPOS_DOCUMENT, URDF_DOCUMENT
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.guards import rated_speed
from humanoid_sim.robots.mjcf import bare_model, compile_spec, read_spec

_SHOWN_GROUPS = 3  # groups of geoms that MuJoCo's own viewer shows
_GIMBAL = 1e-12
_SPECK = 1e-9  # kg and kg·m², of a link between the joints of one body: MuJoCo refuses a moving link without mass
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def body_documents(description: RobotDescription) -> dict[str, str]:
    """Return what a recording's header says of the robot's body, for `humanoid_sim.recording.body`."""
    model = bare_model(description)
    return {URDF_DOCUMENT: urdf_of(model, description), QPOS_DOCUMENT: qpos_addresses(model)}


def qpos_addresses(model: mujoco.MjModel) -> str:
    """Return where the value of each joint begins in `qpos`, by the joint's name in the URDF, as JSON."""
    joints = [link for link in links_of(model) if link.joint_id >= 0]
    return json.dumps({link.joint: int(model.jnt_qposadr[link.joint_id]) for link in joints})


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A link, and the joint that carries it. Its frame has its body's axes and its origin in the joint's anchor."""

    name: str
    parent: str
    joint: str
    kind: str  # `fixed`, `revolute`, `continuous`, `prismatic`, `floating`
    position: FloatArray
    """Shape (3,), m, world frame, with all joints at 0."""
    quaternion: FloatArray
    """Shape (4,), w x y z, likewise."""
    axis: FloatArray
    """Shape (3,), of the joint, link frame."""
    joint_id: int  # in the model; -1 for a fixed joint
    body: int  # whose geoms it has; -1 between the joints of one body
    shift: FloatArray
    """Shape (3,), m: the link's origin in its body's frame."""


_ORIGIN, _LEVEL = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
_WORLD = Link("world", "", "", "fixed", _ORIGIN, _LEVEL, _ORIGIN, -1, 0, _ORIGIN)


def links_of(model: mujoco.MjModel) -> tuple[Link, ...]:
    """Return the links of a model, parents first, after the link `world`, which has no joint.

    A MuJoCo body may have several joints; here each has a link of its own. A body without joints is fixed to its
    parent.
    """
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[np.isin(model.jnt_type, _SCALAR)]] = 0.0
    mujoco.mj_kinematics(model, data)
    links, names = [], {0: _WORLD.name}
    for body in range(1, model.nbody):
        name, parent = model.body(body).name or f"body_{body}", names[int(model.body_parentid[body])]
        names[body] = name
        place, turn = data.xpos[body].copy(), data.xquat[body].copy()
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if not count:
            links.append(Link(name, parent, f"{name}_fixed", "fixed", place, turn, _ORIGIN, -1, body, _ORIGIN))
        for joint in range(first, first + count):
            joint_name, is_last = model.joint(joint).name or f"joint_{joint}", joint == first + count - 1
            link = Link(
                name=name if is_last else f"{name}_{joint_name}",
                parent=parent,
                joint=joint_name,
                kind=_kind(model, joint),
                position=data.xanchor[joint].copy(),
                quaternion=turn,
                axis=rotate_inverse(turn, data.xaxis[joint]),
                joint_id=joint,
                body=body if is_last else -1,
                shift=rotate_inverse(turn, data.xanchor[joint] - place),
            )
            links.append(link)
            parent = link.name
    return tuple(links)


def _kind(model: mujoco.MjModel, joint: int) -> str:
    kind = mujoco.mjtJoint(int(model.jnt_type[joint]))
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        return "revolute" if model.jnt_limited[joint] else "continuous"
    return "prismatic" if kind == mujoco.mjtJoint.mjJNT_SLIDE else "floating"


def urdf_of(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Return the robot as URDF: links, joints with their limits, inertia, and geoms as spheres, cylinders and boxes.

    A capsule is a cylinder and two spheres; a mesh or an ellipsoid is the box around it. Geoms that MuJoCo's viewer
    shows are `visual`, those that can collide are `collision`. The IMU is a link of its own. A floating base hangs on
    the link `world` by a joint of type `floating`.
    """
    root = Element("robot", name=description.name)
    links = (_WORLD, *links_of(model))
    by_name, by_body = ({getattr(link, key): link for link in links} for key in ("name", "body"))
    for link in links:
        element = SubElement(root, "link", name=link.name)
        if link.body < 0:
            _add_inertia(element, _SPECK, np.full(3, _SPECK))
            continue
        if mass := float(model.body_mass[link.body]):
            inertial = _add_inertia(element, mass, model.body_inertia[link.body])
            _add_origin(inertial, model.body_ipos[link.body] - link.shift, model.body_iquat[link.body])
        _add_geoms(element, model, link)
    limits = _limits(description)
    for link in links[1:]:
        parent = by_name[link.parent]
        joint = _add_joint(root, link.joint, link.kind, link.parent, link.name)
        place = rotate_inverse(parent.quaternion, link.position - parent.position)
        _add_origin(joint, place, multiply(conjugate(parent.quaternion), link.quaternion))
        if link.kind in ("revolute", "prismatic", "continuous"):
            SubElement(joint, "axis", xyz=_numbers(link.axis))
            lower, upper = model.jnt_range[link.joint_id]
            own = {"lower": _number(lower), "upper": _number(upper), "effort": "0.0", "velocity": "0.0"}
            SubElement(joint, "limit", limits.get(link.joint, own))
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, description.imu)
    if site >= 0 and description.imu not in by_name:
        owner = by_body[int(model.site_bodyid[site])]
        SubElement(root, "link", name=description.imu)
        joint = _add_joint(root, f"{description.imu}_fixed", "fixed", owner.name, description.imu)
        _add_origin(joint, model.site_pos[site] - owner.shift, model.site_quat[site])
    indent(root)
    return tostring(root, encoding="unicode")


def _limits(description: RobotDescription) -> dict[str, dict[str, str]]:
    """Return the limits of the robot's joints by name; effort and velocity are 0 where they are not known."""
    limits = {}
    for joint, speed in zip(description.joints, rated_speed(description).tolist(), strict=True):
        values = {"lower": joint.lower, "upper": joint.upper, "effort": joint.effort_limit, "velocity": speed}
        limits[joint.name] = {name: _number(value) for name, value in values.items() if math.isfinite(value)}
        limits[joint.name] = {"effort": "0.0", "velocity": "0.0"} | limits[joint.name]
    return limits


def _add_joint(root: Element, name: str, kind: str, parent: str, child: str) -> Element:
    joint = SubElement(root, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    return joint


def _add_inertia(element: Element, mass: float, inertia: FloatArray) -> Element:
    """Add a mass in kg, and its principal moments of inertia (3,), kg·m²."""
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "mass", value=_number(mass))
    xx, yy, zz = (_number(value) for value in inertia)
    SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy="0", ixz="0", iyz="0")
    return inertial


def _add_geoms(element: Element, model: mujoco.MjModel, link: Link) -> None:
    for geom in np.flatnonzero(model.geom_bodyid == link.body).tolist():
        tags = ["visual"] if model.geom_group[geom] < _SHOWN_GROUPS else []
        tags += ["collision"] if model.geom_contype[geom] | model.geom_conaffinity[geom] else []
        position, quaternion = model.geom_pos[geom] - link.shift, model.geom_quat[geom]
        material = int(model.geom_matid[geom])
        colour = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        for shape, attributes, offset in _shapes(model, geom):
            for tag in tags:
                part = SubElement(element, tag)
                _add_origin(part, position + rotate(quaternion, offset), quaternion)
                SubElement(SubElement(part, "geometry"), shape, attributes)
                if tag == "visual":
                    SubElement(SubElement(part, "material", name=f"geom_{geom}"), "color", rgba=_numbers(colour))


def _shapes(model: mujoco.MjModel, geom: int) -> Iterator[tuple[str, dict[str, str], FloatArray]]:
    """Yield what a geom is made of: the tag, its attributes, and where it is in the geom's frame, (3,) m."""
    kind, (radius, half, _) = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    match kind:
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            yield "sphere", {"radius": _number(radius)}, _ORIGIN
        case mujoco.mjtGeom.mjGEOM_CAPSULE | mujoco.mjtGeom.mjGEOM_CYLINDER:
            yield "cylinder", {"radius": _number(radius), "length": _number(2.0 * half)}, _ORIGIN
            for end in (-half, half) if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else ():
                yield "sphere", {"radius": _number(radius)}, np.array([0.0, 0.0, end])
        case mujoco.mjtGeom.mjGEOM_BOX | mujoco.mjtGeom.mjGEOM_ELLIPSOID | mujoco.mjtGeom.mjGEOM_MESH:
            yield "box", {"size": _numbers(2.0 * model.geom_aabb[geom, 3:])}, model.geom_aabb[geom, :3]


def _add_origin(element: Element, position: FloatArray, quaternion: FloatArray) -> None:
    SubElement(element, "origin", xyz=_numbers(position), rpy=_numbers(_roll_pitch_yaw(quaternion)))


def _roll_pitch_yaw(quaternion: FloatArray) -> FloatArray:
    """Shape (3,), rad, about the fixed axes x, y, z in this order: URDF's."""
    rotation = matrix(np.asarray(quaternion, dtype=np.float64))
    level = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch = math.atan2(-rotation[2, 0], level)
    if level < _GIMBAL:  # roll and yaw turn about one axis
        return np.array([math.atan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    return np.array([math.atan2(rotation[2, 1], rotation[2, 2]), pitch, math.atan2(rotation[1, 0], rotation[0, 0])])


def _numbers(values: FloatArray) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    return repr(round(float(value), 12) + 0.0)


def convert_urdf(
    path: Path, base: Literal["floating", "fixed"], folder: Path, imu: str | None = None
) -> tuple[str, list[str]]:
    """Return the MJCF of a URDF for a file in `folder`, and a line for each thing that the URDF does not say.

    Each link stays a body of its own; `base` gives the root link a free joint, or none; `imu` is the link with the IMU.
    Raises `InputError` if it is not a URDF, a mesh is missing, there is no such link, or it does not compile.
    """
    regular_file(path, "a URDF")
    if path.suffix != ".urdf":
        raise InputError(f"{path}: is not a .urdf")
    spec = read_spec(path)
    spec.compiler.fusestatic = False  # MuJoCo merges links without a joint into their parents
    for mesh in spec.meshes:
        mesh.file = os.path.relpath(path.resolve().parent / spec.meshdir / mesh.file, folder.resolve())
    spec.meshdir = ""
    roots = spec.worldbody.bodies
    if len(roots) != 1:
        raise InputError(f"{path}: has {len(roots)} root links, expected one")
    has_free_joint = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in roots[0].joints)
    if base == "floating" and not has_free_joint:
        roots[0].add_freejoint(name="floating_base")
    if base == "fixed" and has_free_joint:
        raise InputError(f"{path}: its root link '{roots[0].name}' has a floating joint, expected --base floating")
    if imu is not None:
        require_known("link", [imu], [body.name for body in spec.bodies if body.name != "world"], f"{path}: --imu: ")
        spec.body(imu).add_site(name="imu")
        spec.add_sensor(name="gyro", type=mujoco.mjtSensor.mjSENS_GYRO, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
    spec.modelfiledir = str(folder.resolve())
    model = compile_spec(spec, path)
    text: str = spec.to_xml()
    return text, _gaps(model, imu)


def _gaps(model: mujoco.MjModel, imu: str | None) -> list[str]:
    """Return what a URDF cannot say, or this one does not."""
    hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    without = int((model.dof_armature[model.jnt_dofadr[hinges]] == 0.0).sum())
    colliding = int((model.geom_contype > 0).sum())
    unlimited, weak = (
        ", ".join(model.joint(int(i)).name for i in hinges if not limited[i])
        for limited in (model.jnt_limited, model.jnt_actfrclimited)
    )
    lines = {
        f"armature: {without} joints have none; add each motor's rotor inertia times its gear ratio squared (kg m²): "
        "without it damping chatters": without,
        f"range: none for {unlimited}": unlimited,
        f"effort limit: none for {weak}": weak,
        "IMU: no site; --imu LINK adds one": imu is None,
        f"contacts: {colliding} geoms collide with everything, the robot's own among them; leave the feet, or add "
        "<exclude> for bodies that touch": colliding,
    }
    return [line for line, is_missing in lines.items() if is_missing]
