"""MJCF files: reading and compiling them, and any user's robot described by nothing else."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import (
    BaseSettings,
    DampingSettings,
    JointDescription,
    RobotDescription,
    SimulationSettings,
    StandbySettings,
    steps_per_period,
)

NO_RANGE = (-math.inf, math.inf)
ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_SITE = mujoco.mjtObj.mjOBJ_SITE
_UNNAMED = "MuJoCo Model"  # MuJoCo's name of a model that has none
_LONGEST_TIMESTEP = {"fixed": 0.0005, "floating": 0.001}  # s: resolves contacts of feet; damping is stable
_STANDBY_SECONDS = 2.0
_MUJOCO_ERRORS = (ValueError, mujoco.FatalError)
# An attribute that may hold names. Classes keep a prefix: `main` is one that every model has.
_ATTRIBUTE = re.compile(r"""(\s(?!class\b|childclass\b|file\b)\w+=["'])([^"']*)""")
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
        names = [name for body in spec.bodies for joint in body.joints for name in (joint.name, body.name) if name]
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
        try:
            return spec.compile()
        except _MUJOCO_ERRORS:
            for mesh in spec.meshes:
                if mesh.file and (file := Path(spec.modelfiledir, spec.meshdir, mesh.file)).is_file():
                    regular_file(file, "a mesh")  # MuJoCo does not know what stands in its place
            raise


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
    """
    spec = read_spec(path)
    model = compile_spec(spec, path)
    joints = _robot_joints(model)
    if not joints:
        raise InputError(f"{path}: has no hinge joint, or its actuators drive none, expected a robot")
    base, *others = dict.fromkeys(_root_of(model, i) for i in joints)
    if others and any(_has_free_joint(model, root) for root in (base, *others)):
        roots = ", ".join(f"'{model.body(root).name}'" for root in (base, *others))
        raise InputError(
            f"{path}: its joints are on {roots}, expected one floating base; actuators say which are its own"
        )
    if not all(model.joint(i).name for i in joints) or not model.body(base).name:
        raise InputError(f"{path}: a hinge joint or its base has no name, by which policies find it")
    actuators, described, pose = own_actuators(model), [], []
    for i in joints:
        name = model.joint(i).name
        lower, upper = model.jnt_range[i].tolist() if model.jnt_limited[i] else NO_RANGE
        effort = float(np.abs(actuators[name].force_range).max()) if name in actuators else math.inf
        if model.jnt_actfrclimited[i]:
            effort = min(effort, float(np.abs(model.jnt_actfrcrange[i]).max()))
        described.append(JointDescription(name, lower, upper, effort, stiffness=0.0, damping=0.0))
        pose.append(float(np.clip(model.qpos0[model.jnt_qposadr[i]], lower, upper)))
    zeros = (0.0,) * len(joints)
    standby = StandbySettings(zeros, zeros, (_STANDBY_SECONDS,), (tuple(pose),))
    is_floating = _has_free_joint(model, base)
    timestep = _LONGEST_TIMESTEP["floating" if is_floating else "fixed"]
    with suppress(InputError):  # the model's own, if it divides the control period
        steps_per_period(1.0 / SimulationSettings().control_frequency, model.opt.timestep)
        timestep = min(timestep, float(model.opt.timestep))
    return RobotDescription(
        name=spec.modelname if spec.modelname not in ("", _UNNAMED) else path.stem,
        mjcf=path.name,
        folder=str(path.resolve().parent),
        joints=tuple(described),
        initial_position=tuple(pose),
        imu=_find_imu(model, base),
        base=BaseSettings("floating", model.body(base).name) if is_floating else BaseSettings(),
        simulation=SimulationSettings(physics_timestep=timestep),
        damping_controller=DampingSettings(damping_scalar=0.0),
        standby_controller_a=standby,
        standby_controller_b=standby,
    )


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


def _root_of(model: mujoco.MjModel, joint: int) -> int:
    return int(model.body_rootid[model.jnt_bodyid[joint]])


def _find_imu(model: mujoco.MjModel, base: int) -> str:
    """Return the site of a gyro on the base, else of the only gyro, else named like an IMU; or the base itself."""
    is_gyro = (model.sensor_type == mujoco.mjtSensor.mjSENS_GYRO) & (model.sensor_objtype == _SITE)
    named = [i for i in range(model.nsite) if model.site(i).name]
    gyros = [i for i in named if i in model.sensor_objid[is_gyro] and model.body_rootid[model.site_bodyid[i]] == base]
    on_base = [i for i in named if model.site_bodyid[i] == base]
    places = [i for i in on_base if i in gyros] or (gyros if len(gyros) == 1 else [])
    places = places or [i for i in on_base if "imu" in model.site(i).name.lower()]
    return str(model.site(places[0]).name if places else model.body(base).name)


def imu_line(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Return which frame of a robot's model is its IMU, and on which body."""
    base = _root_of(model, model.joint(description.joints[0].name).id)
    name = description.imu
    site = mujoco.mj_name2id(model, _SITE, name)
    body = model.body(int(model.site_bodyid[site]) if site >= 0 else name)
    owner = "the base" if body.id == base else f"not the base '{model.body(base).name}'"
    return f"site '{name}' on '{body.name}', {owner}" if site >= 0 else f"body '{name}', {owner}"


def odd_gravity(model: mujoco.MjModel) -> str:
    """Return the gravity of a model, and what is odd about it; '' where it is along -z."""
    x, y, z = model.opt.gravity.tolist()
    return "" if (x, y) == (0.0, 0.0) and z < 0.0 else f"{x:g} {y:g} {z:g} m/s²; policies take -z for down"


def own_joint_damping(model: mujoco.MjModel, description: RobotDescription) -> dict[str, float]:
    """Return damping in N·m·s/rad that a `bare_model` itself gives the joints, by name, where it gives any."""
    damping = {name: float(model.joint(name).damping[0]) for name in description.joint_names}
    return {name: value for name, value in damping.items() if value}


@dataclass(frozen=True, slots=True)
class OwnActuator:
    """What the actuators of a model itself do to a joint, at the joint."""

    joint: str
    kind: Literal["servo", "motor", "other"]  # its control is a target of position or velocity, or a force
    stiffness: float  # N·m/rad, K_p; 0 for a motor
    damping: float  # N·m·s/rad, K_d; 0 for a motor
    force_range: tuple[float, float]  # N·m
    target_range: tuple[float, float]  # rad, to which a servo clips its target (`ctrlrange`, `inheritrange`)


def own_actuators(model: mujoco.MjModel) -> dict[str, OwnActuator]:
    """Return what the model's own actuators do to the joints that they drive, by the joint's name."""
    found: dict[str, OwnActuator] = {}
    for i in np.flatnonzero(np.isin(model.actuator_trntype, ON_JOINT)).tolist():
        own = _own_actuator(model, i)
        if other := found.get(own.joint):  # such as one for its position and one for its velocity
            force = (own.force_range[0] + other.force_range[0], own.force_range[1] + other.force_range[1])
            stiffness, damping = own.stiffness + other.stiffness, own.damping + other.damping
            stiffer = own if own.stiffness > other.stiffness else other
            own = replace(stiffer, stiffness=stiffness, damping=damping, force_range=force)
        found[own.joint] = own
    return found


def _own_actuator(model: mujoco.MjModel, i: int) -> OwnActuator:
    joint, gear = model.joint(int(model.actuator_trnid[i, 0])).name, float(model.actuator_gear[i, 0])
    gain = float(model.actuator_gainprm[i, 0])
    rest, stiffness, damping = (0.0 - float(value) for value in model.actuator_biasprm[i, :3])
    force = _range(model.actuator_forcerange[i] * gear, bool(model.actuator_forcelimited[i]))
    control = np.array(_range(model.actuator_ctrlrange[i], bool(model.actuator_ctrllimited[i])))
    is_fixed = bool(model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED)
    if is_fixed and model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_AFFINE:
        is_position = stiffness * gear != 0.0  # its target is where it has no force
        target = _range((gain * control - rest) / (stiffness * gear), True) if is_position else NO_RANGE
        return OwnActuator(joint, "servo", stiffness * gear**2, damping * gear**2, force, target)
    if is_fixed and model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE and not model.actuator_dyntype[i]:
        low, high = _range(control * gain * gear, True)
        return OwnActuator(joint, "motor", 0.0, 0.0, (max(force[0], low), min(force[1], high)), NO_RANGE)
    return OwnActuator(joint, "other", 0.0, 0.0, force, NO_RANGE)


def _range(values: FloatArray, is_limited: bool) -> tuple[float, float]:
    return (float(min(values)), float(max(values))) if is_limited else NO_RANGE
