"""URDF: written of a compiled MJCF for viewers, with primitive geometry and no files; and read into an MJCF."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import conjugate, matrix, multiply, rotate, rotate_inverse
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.guards import rated_speed
from humanoid_sim.robots.mjcf import compile_spec, read_spec

_SHOWN_GROUPS = 3  # groups of geoms that MuJoCo's own viewer shows
_SPECK = 1e-9  # kg and kg·m², of a link between the joints of one body: MuJoCo refuses a moving link without mass
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_KINDS = {_HINGE: "revolute", _SLIDE: "prismatic"}
_ORIGIN, _LEVEL = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


class _Link(NamedTuple):  # with all joints at 0: its body's axes, its origin in its joint's anchor
    name: str
    position: FloatArray  # shape (3,), m, world frame
    quaternion: FloatArray  # shape (4,), w x y z


def urdf_of(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Return the robot as URDF, with the geoms that MuJoCo's viewer shows as spheres, cylinders and boxes.

    The IMU is a link of its own, and so is each joint of a body with several. A floating base hangs on `world`.
    """
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[np.isin(model.jnt_type, (_HINGE, _SLIDE))]] = 0.0
    mujoco.mj_kinematics(model, data)
    root = Element("robot", name=description.name)
    _add_geoms(SubElement(root, "link", name="world"), model, 0, _ORIGIN)
    links = [_Link("world", _ORIGIN, _LEVEL)]  # the last of each body
    for body in range(1, model.nbody):
        name, place, turn = model.body(body).name or f"body_{body}", data.xpos[body], data.xquat[body]
        link, first = links[model.body_parentid[body]], int(model.body_jntadr[body])
        own = range(first, first + int(model.body_jntnum[body])) or (-1,)  # -1: fixed to its parent
        for i in own:
            joint_name, kind, anchor = f"{name}_fixed", "fixed", place
            if i >= 0:
                joint_name, anchor = model.joint(i).name or f"joint_{i}", data.xanchor[i]
                kind = _KINDS.get(int(model.jnt_type[i]), "floating")
            if kind == "revolute" and not model.jnt_limited[i]:
                kind = "continuous"
            parent, link = link, _Link(name if i == own[-1] else f"{name}_{joint_name}", anchor, turn)
            joint = _add_joint(root, joint_name, kind, parent, link)
            if kind not in ("fixed", "floating"):
                SubElement(joint, "axis", xyz=_numbers(rotate_inverse(turn, data.xaxis[i])))
                SubElement(joint, "limit", _limit(model.jnt_range[i], joint_name, description))
            element, shift = SubElement(root, "link", name=link.name), rotate_inverse(turn, place - anchor)
            if i != own[-1]:
                _add_inertia(element, _SPECK, np.full(3, _SPECK), _ORIGIN, _LEVEL)
        if mass := float(model.body_mass[body]):
            _add_inertia(element, mass, model.body_inertia[body], model.body_ipos[body] + shift, model.body_iquat[body])
        _add_geoms(element, model, body, shift)
        links.append(link)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, description.imu)
    if site >= 0 and description.imu not in [link.name for link in links]:
        owner = int(model.site_bodyid[site])
        SubElement(root, "link", name=description.imu)
        imu = _Link(description.imu, data.site_xpos[site], multiply(data.xquat[owner], model.site_quat[site]))
        _add_joint(root, f"{description.imu}_fixed", "fixed", links[owner], imu)
    indent(root)
    return tostring(root, encoding="unicode")


def _add_joint(root: Element, name: str, kind: str, parent: _Link, child: _Link) -> Element:
    joint = SubElement(root, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent.name)
    SubElement(joint, "child", link=child.name)
    place = rotate_inverse(parent.quaternion, child.position - parent.position)
    _add_origin(joint, place, multiply(conjugate(parent.quaternion), child.quaternion))
    return joint


def _limit(span: FloatArray, name: str, robot: RobotDescription) -> dict[str, str]:
    (lower, upper), effort, speed = span, 0.0, 0.0
    if name in robot.joint_names:
        i = robot.joint_names.index(name)
        lower, upper, effort, speed = robot.lower[i], robot.upper[i], robot.effort_limit[i], rated_speed(robot)[i]
    bounds = {"lower": lower, "upper": upper} if math.isfinite(upper - lower) else {}
    values = {**bounds, "effort": effort, "velocity": speed}
    return {key: _number(value if math.isfinite(value) else 0.0) for key, value in values.items()}


def _add_inertia(element: Element, mass: float, inertia: FloatArray, centre: FloatArray, axes: FloatArray) -> None:
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "mass", value=_number(mass))
    xx, yy, zz = (_number(value) for value in inertia)
    SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy="0", ixz="0", iyz="0")
    _add_origin(inertial, centre, axes)


def _add_geoms(element: Element, model: mujoco.MjModel, body: int, shift: FloatArray) -> None:
    for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_group < _SHOWN_GROUPS)).tolist():
        position, quaternion = model.geom_pos[geom] + shift, model.geom_quat[geom]
        material = int(model.geom_matid[geom])
        colour = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        for shape, attributes, offset in _shapes(model, geom):
            part = SubElement(element, "visual")
            _add_origin(part, position + rotate(quaternion, offset), quaternion)
            SubElement(SubElement(part, "geometry"), shape, attributes)
            SubElement(SubElement(part, "material", name=f"geom_{geom}"), "color", rgba=_numbers(colour))


def _shapes(model: mujoco.MjModel, geom: int) -> Iterator[tuple[str, dict[str, str], FloatArray]]:
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
    rotation = matrix(np.asarray(quaternion, dtype=np.float64))
    level = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch = math.atan2(-rotation[2, 0], level)
    if level < 1e-12:  # roll and yaw turn about one axis
        return np.array([math.atan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    return np.array([math.atan2(rotation[2, 1], rotation[2, 2]), pitch, math.atan2(rotation[1, 0], rotation[0, 0])])


def _numbers(values: FloatArray) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    return repr(round(float(value), 12) + 0.0)


def convert_urdf(path: Path, base: Literal["floating", "fixed"], folder: Path, imu: str | None = None) -> str:
    """Return the MJCF of a URDF for a file in `folder`; `imu` is the link with the IMU.

    Raises `InputError` if it is not a URDF, a mesh is missing, there is no such link, or it does not compile.
    """
    text = regular_file(path, "a URDF").read_text(encoding="utf-8", errors="replace")
    if path.suffix == ".xacro" or "${" in text or "<xacro:" in text:
        raise InputError(f"{path}: holds xacro, expected a URDF: expand it with xacro")
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
    free = [joint for joint in roots[0].joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if base == "floating" and not free:
        roots[0].add_freejoint(name="floating_base")
    if base == "fixed" and free:
        raise InputError(f"{path}: its root link '{roots[0].name}' has a floating joint, expected --base floating")
    if imu is not None:
        require_known("link", [imu], [body.name for body in spec.bodies if body.name != "world"], f"{path}: --imu: ")
        spec.body(imu).add_site(name="imu")
        spec.add_sensor(name="gyro", type=mujoco.mjtSensor.mjSENS_GYRO, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
    spec.modelfiledir = str(folder.resolve())
    compile_spec(spec, path)
    return str(spec.to_xml())
