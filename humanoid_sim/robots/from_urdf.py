"""A URDF as an MJCF: what MuJoCo reads of it, on the base that the user names, and what a URDF cannot say."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

import mujoco

from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import regular_file
from humanoid_sim.robots.mjcf import compile_spec, read_spec

BaseKind = Literal["floating", "fixed"]


def convert_urdf(path: Path, base: BaseKind, folder: Path, imu: str | None = None) -> tuple[str, list[str]]:
    """Return the MJCF of a URDF, and a line for each thing that it lacks.

    MuJoCo by itself fixes a URDF's root to the world and merges it and every other link without a joint into its
    parent. Here each link stays a body of its own. Raises `InputError` if it is not a URDF, a mesh
    is not found, there is no such link, or MuJoCo cannot compile it.

    Args:
        path: of the URDF. Meshes are looked for beside it, in its `meshdir`, and by the last part of their name there.
        base: `floating` gives the root link a free joint.
        folder: where the MJCF will be, to which its meshes' paths are relative.
        imu: the link that the IMU is fixed to, along its axes; None for none.
    """
    regular_file(path, "a URDF")
    if path.suffix != ".urdf":
        raise InputError(f"{path}: is not a .urdf")
    spec = read_spec(path)
    spec.compiler.fusestatic = False
    _find_meshes(spec, path, folder)
    roots = spec.worldbody.bodies
    if len(roots) != 1:
        raise InputError(f"{path}: has {len(roots)} root links, expected one")
    free = [joint for joint in roots[0].joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if base == "floating" and not free:
        roots[0].add_freejoint(name="floating_base")
    if base == "fixed" and free:
        raise InputError(f"{path}: its root link '{roots[0].name}' has a floating joint, expected --base floating")
    if imu is not None:
        link = spec.body(imu)
        if link is None:
            names = ", ".join(body.name for body in spec.bodies if body.name != "world")
            raise InputError(f"{path}: has no link '{imu}' for the IMU; links: {names}")
        link.add_site(name="imu")
        spec.add_sensor(name="gyro", type=mujoco.mjtSensor.mjSENS_GYRO, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
    spec.modelfiledir = str(folder.resolve())
    model = compile_spec(spec, path)
    with blaming(f"{path}: cannot be written as an MJCF", (ValueError, RuntimeError, mujoco.FatalError)):
        text: str = spec.to_xml()
    return text, _gaps(model, imu)


def _find_meshes(spec: mujoco.MjSpec, path: Path, folder: Path) -> None:
    """Give each mesh its path from `folder`; MuJoCo's own reader looks in one place only."""
    here = path.resolve().parent
    for mesh in spec.meshes:
        name = mesh.file.partition("://")[2].partition("/")[2] or mesh.file
        places = (here / spec.meshdir / name, here / name, here / spec.meshdir / Path(name).name)
        found = next((place for place in places if place.is_file()), None)
        if found is None:
            looked = ", ".join(dict.fromkeys(os.path.relpath(place.parent, here) for place in places))
            raise InputError(f"{path}: mesh '{mesh.file}' is not found; looked beside the URDF in: {looked}")
        mesh.file = os.path.relpath(found, folder.resolve())
    spec.meshdir = ""


def _gaps(model: mujoco.MjModel, imu: str | None) -> list[str]:
    """Return what a URDF cannot say, or this one does not."""
    hinges = [i for i in range(model.njnt) if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE]
    unlimited = [model.joint(i).name for i in hinges if not model.jnt_limited[i]]
    weak = [model.joint(i).name for i in hinges if not model.jnt_actfrclimited[i]]
    without = [i for i in hinges if model.dof_armature[model.jnt_dofadr[i]] == 0.0]
    colliding = int((model.geom_contype > 0).sum())
    lines = []
    if without:
        lines.append(
            f"armature: {len(without)} joints have none; add each motor's rotor inertia times its gear ratio squared "
            "(kg m²), or damping chatters"
        )
    if unlimited:
        lines.append(f"range: none for {', '.join(unlimited)}")
    if weak:
        lines.append(f"effort limit: none for {', '.join(weak)}")
    if imu is None:
        lines.append("IMU: no site; --imu LINK adds one")
    if colliding:
        lines.append(
            f"contacts: {colliding} geoms collide with everything, the robot's own among them; leave the feet, or add "
            "<exclude> for bodies that touch"
        )
    return lines
