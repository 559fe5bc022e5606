"""MJCF files: reading and compiling them, and any user's robot described by nothing else."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from pathlib import Path

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.robots.actuators import NO_RANGE, OwnActuator, own_actuators
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.robots.schema import (
    BaseSettings,
    DampingSettings,
    JointDescription,
    RobotDescription,
    SimulationSettings,
    StandbySettings,
)

_SITE = mujoco.mjtObj.mjOBJ_SITE
_SENSOR = mujoco.mjtSensor
_FRAME = (_SENSOR.mjSENS_ACCELEROMETER, _SENSOR.mjSENS_FRAMEQUAT, _SENSOR.mjSENS_FRAMEZAXIS, _SENSOR.mjSENS_FRAMEANGVEL)
"""Sensors of an orientation, or of how it moves; those of positions alone are often a foot's."""
_UNNAMED = "MuJoCo Model"  # MuJoCo's name of a model that has none
_LONGEST_TIMESTEP = {"fixed": 0.0005, "floating": 0.001}
"""s. Contacts of feet are well resolved there, and damping is stable for any robot that has its motors' inertia."""
_STANDBY_SECONDS = 2.0
_MUJOCO_ERRORS = (ValueError, mujoco.FatalError)
_ATTRIBUTE = re.compile(r"""(\s(?!class\b|childclass\b|file\b)\w+=["'])([^"']*)""")
"""An attribute that may hold names. Classes keep a prefix: `main` is one that every model has."""
_PACKAGE = re.compile(r"package:/+([^/]+)/(.*)")


def read_spec(path: Path) -> mujoco.MjSpec:
    """Read the editable model of an MJCF or a URDF, without a prefix that all names have in common.

    mjlab's `export_scene` begins every name with `robot/`; its policies name the joints without it. Meshes of ROS
    packages are found in the folders above the file. Raises `InputError` with what is wrong.
    """
    if mujoco.get_mju_user_warning() is None:  # else on stderr and in MUJOCO_LOG.TXT; `MjData.warning` still counts
        mujoco.set_mju_user_warning(lambda _: None)
    regular_file(path, "the robot's MJCF model")
    with blaming(f"{path}: not a valid {'URDF' if path.suffix == '.urdf' else 'MJCF model'}", _MUJOCO_ERRORS):
        spec = mujoco.MjSpec.from_file(str(path))
        names = [name for joint in spec.joints for name in (joint.name, joint.parent.name) if name]
        prefixes = {name[: name.find("/") + 1] for name in names}
        text = path.read_text(encoding="utf-8") if path.suffix == ".xml" else ""
        if len(prefixes) == 1 and "" not in prefixes and text and "<include" not in text:  # included names would stay
            word, folder = re.compile(rf"(?<!\S){re.escape(prefixes.pop())}"), spec.modelfiledir
            spec = mujoco.MjSpec.from_string(_ATTRIBUTE.sub(lambda found: found[1] + word.sub("", found[2]), text))
            spec.modelfiledir = folder
    for asset in (*spec.meshes, *spec.textures):
        if package := _PACKAGE.match(asset.file):
            asset.file = str(_package_file(package[1], package[2], path.resolve()))
    return spec


def _package_file(package: str, name: str, model: Path) -> Path:
    for above in model.parents:
        manifest = above / "package.xml"
        says_so = manifest.is_file() and f"<name>{package}</name>" in manifest.read_text(errors="replace")
        place = (above if says_so or above.name == package else above / package) / name
        if place.is_file():
            return place
    raise InputError(f"{model}: does not find package://{package}/{name}, expected the package above the model")


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Compile a model, which messages call `path`. Raises `InputError` where that fails."""
    with blaming(f"{path}: does not compile", _MUJOCO_ERRORS):
        return spec.compile()


def bare_model(description: RobotDescription) -> mujoco.MjModel:
    """Return the robot's MJCF as it is, compiled; it has to have the description's joints and IMU."""
    path = description.mjcf_path
    model = compile_spec(read_spec(path), path)
    require_known("joint", description.joint_names, [model.joint(i).name for i in range(model.njnt)], f"{path}: ")
    frames = [model.site(i).name for i in range(model.nsite)] + [model.body(i).name for i in range(1, model.nbody)]
    known = [name for name in frames if name]
    require_known("site or body", [description.imu], known, f"{path}: imu of '{description.name}': ")
    return model


def describe_mjcf(path: Path) -> RobotDescription:
    """Describe the robot in an MJCF file: actuated hinge joints in its order, limits, base, IMU.

    Without actuators all hinge joints are the robot's; other joints stay passive. Gains are 0: they are the policy's.
    Raises `InputError` if there is no hinge joint, or a name is missing.
    """
    spec = read_spec(path)
    model = compile_spec(spec, path)
    joints = _robot_joints(model)
    if not joints:
        raise InputError(f"{path}: has no hinge joint, expected a robot")
    base = _root_of(model, joints[0])
    if not all(model.joint(i).name for i in joints) or not model.body(base).name:
        raise InputError(
            f"{path}: a hinge joint or its base has no name, expected names, as policies find joints by name"
        )
    own, zeros = own_actuators(model), (0.0,) * len(joints)
    described = tuple(_describe_joint(model, i, own.get(model.joint(i).name)) for i in joints)
    starts = zip(model.qpos0[model.jnt_qposadr[joints]].tolist(), described, strict=True)
    pose = tuple(min(max(value, joint.lower), joint.upper) for value, joint in starts)
    standby = StandbySettings(zeros, zeros, (_STANDBY_SECONDS,), (pose,))
    is_floating = _has_free_joint(model, base)
    return RobotDescription(
        name=spec.modelname if spec.modelname not in ("", _UNNAMED) else path.stem,
        mjcf=path.name,
        folder=str(path.resolve().parent),
        joints=described,
        initial_position=pose,
        imu=_find_imu(model, base)[0],
        base=BaseSettings("floating", model.body(base).name) if is_floating else BaseSettings(),
        simulation=SimulationSettings(physics_timestep=_timestep(model, is_floating)),
        damping_controller=DampingSettings(damping_scalar=0.0),
        standby_controller_a=standby,
        standby_controller_b=standby,
    )


def _describe_joint(model: mujoco.MjModel, i: int, own: OwnActuator | None) -> JointDescription:
    lower, upper = model.jnt_range[i].tolist() if model.jnt_limited[i] else NO_RANGE
    effort = math.inf if own is None else max(abs(bound) for bound in own.force_range)
    if model.jnt_actfrclimited[i]:
        effort = min(effort, float(np.abs(model.jnt_actfrcrange[i]).max()))
    return JointDescription(model.joint(i).name, lower, upper, effort, stiffness=0.0, damping=0.0)


def _robot_joints(model: mujoco.MjModel) -> list[int]:
    hinges = [i for i in range(model.njnt) if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE]
    if model.nu:
        driven = own_actuators(model)
        return [i for i in hinges if model.joint(i).name in driven]
    floating = [i for i in hinges if _has_free_joint(model, _root_of(model, i))]
    return floating or hinges  # doors and other furniture have hinges too


def _has_free_joint(model: mujoco.MjModel, body: int) -> bool:
    joint = int(model.body_jntadr[body])
    return joint >= 0 and bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE)


def _timestep(model: mujoco.MjModel, is_floating: bool) -> float:
    longest, own = _LONGEST_TIMESTEP["floating" if is_floating else "fixed"], float(model.opt.timestep)
    with suppress(InputError):
        steps_per_period(1.0 / SimulationSettings().control_frequency, own)
        return min(own, longest)
    return longest


def _root_of(model: mujoco.MjModel, joint: int) -> int:
    return int(model.body_rootid[model.jnt_bodyid[joint]])


def _find_imu(model: mujoco.MjModel, base: int) -> tuple[str, str]:
    sites = [i for i in np.flatnonzero(model.body_rootid[model.site_bodyid] == base).tolist() if model.site(i).name]
    gyros, frames = _with_sensor(model, sites, (_SENSOR.mjSENS_GYRO,)), _with_sensor(model, sites, _FRAME)
    named = [i for i in sites if "imu" in model.site(i).name.lower() and model.site_bodyid[i] == base]
    for found, why in (
        ([i for i in gyros if model.site_bodyid[i] == base], "the site of a gyro"),
        (gyros if len(gyros) == 1 else [], "the site of the only gyro"),
        (named, "a site of the base named like an IMU"),
        (frames if len(frames) == 1 else [], "the only site with a sensor of its orientation"),
    ):
        if found:
            return model.site(found[0]).name, why
    return model.body(base).name, "no site of the model is clearly the IMU"


def _with_sensor(model: mujoco.MjModel, sites: list[int], kinds: tuple[mujoco.mjtSensor, ...]) -> list[int]:
    chosen = np.isin(model.sensor_type, [int(kind) for kind in kinds]) & (model.sensor_objtype == int(_SITE))
    return [i for i in dict.fromkeys(model.sensor_objid[chosen].tolist()) if i in sites]


def imu_line(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Return which frame of a robot's model is its IMU, on which body, and why that one."""
    base = _root_of(model, model.joint(description.joints[0].name).id)
    name, (found, why) = description.imu, _find_imu(model, base)
    site = mujoco.mj_name2id(model, _SITE, name)
    body = model.body(int(model.site_bodyid[site]) if site >= 0 else name)
    owner = "the base" if body.id == base else f"not the base '{model.body(base).name}'"
    frame = f"site '{name}' on '{body.name}'" if site >= 0 else f"body '{name}'"
    return f"{frame}, {owner} ({why if name == found else 'as it was given'})"
