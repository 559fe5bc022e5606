"""MJCF files, and a robot description from nothing but one: any user's robot by path.

`describe_mjcf` reads from the model: the actuated hinge joints in its order (all hinge joints, if it has no actuators),
their limits, effort limits as far as it gives them, the base, and the IMU. Other joints stay passive. Gains are 0: they
come from the policy's contract, see `humanoid_sim.robots.description`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Literal

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.robots.schema import (
    BaseSettings,
    DampingSettings,
    JointDescription,
    RobotDescription,
    SimulationSettings,
    StandbySettings,
)

_UNNAMED = "MuJoCo Model"
"""The name that MuJoCo gives to a model that has none."""

_LONGEST_TIMESTEP = {"fixed": 0.0005, "floating": 0.001}
"""s. Contacts of feet are well resolved there, and damping is stable for any robot that has its motors' inertia."""

_STANDBY_SECONDS = 2.0
_NO_ROOM = (MemoryError, RuntimeError, mujoco.FatalError)
"""Errors that MuJoCo raises where it finds no memory, or does not know what went wrong."""
_FINITE = (
    *("body_pos", "body_quat", "body_mass", "body_inertia", "body_ipos"),
    *("geom_pos", "geom_quat", "geom_size", "site_pos", "jnt_pos", "jnt_axis"),
)
"""Arrays of a model in which MuJoCo lets NaN and infinity pass."""
_ATTRIBUTE = re.compile(r"""(\s(?!class\b|childclass\b|file\b)\w+=["'])([^"']*)""")
"""An attribute that may hold names. Classes keep a prefix: `main` is one that every model has."""
_OWNER = {"body": "body", "geom": "geom", "site": "site", "jnt": "joint"}


NO_RANGE = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True)
class OwnActuator:
    """What the actuators of a model itself do to a joint, at the joint; simulations leave them out."""

    joint: str
    kind: Literal["servo", "motor", "other"]
    """`servo`: its control is a target of a position or a velocity; `motor`: its control is a force."""
    stiffness: float
    """N·m/rad, K_p; 0 for a motor."""
    damping: float
    """N·m·s/rad, K_d; 0 for a motor."""
    force_range: tuple[float, float]
    """N·m, `NO_RANGE` where there is none."""
    target_range: tuple[float, float]
    """rad, to which a servo clips its target (`ctrlrange`, `inheritrange`); `NO_RANGE` where it does not."""


class _Silence:
    """`with mujoco_silenced:` nothing is written to stderr, and no file MUJOCO_LOG.TXT; `MjData.warning` still counts.

    MuJoCo has one handler of warnings for the whole process, and several simulations may be stepped at the same time:
    who enters takes it, the last to leave puts back what there was. A handler that somebody else set meanwhile counts
    as what there was: it is put back, and does not hear of what is simulated here.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._users = 0
        self._handler: object = None

    def __enter__(self) -> None:
        with self._lock:
            present = mujoco.get_mju_user_warning()
            if present is not _ignore:
                self._handler = present
                mujoco.set_mju_user_warning(_ignore)
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0 and mujoco.get_mju_user_warning() is _ignore:
                mujoco.set_mju_user_warning(self._handler)


def _ignore(message: str) -> None:
    del message


mujoco_silenced = _Silence()


def read_spec(path: Path) -> mujoco.MjSpec:
    """Read the editable model of an MJCF file, its includes resolved, its names without a prefix common to all.

    mjlab's `export_scene` begins every name with `robot/`; its policies name the joints without it. Raises `InputError`
    where there is no such file, or it is not an MJCF.
    """
    spec = _read(path)
    prefix = _common_prefix(spec, path)
    if not prefix:
        return spec
    word = re.compile(rf"(?<!\S){re.escape(prefix)}")
    text = _ATTRIBUTE.sub(lambda found: found[1] + word.sub("", found[2]), path.read_text(encoding="utf-8"))
    what = f"{path}: not a valid MJCF model without the prefix {prefix!r}"
    with blaming(what, (ValueError, *_NO_ROOM)), mujoco_silenced:
        renamed = mujoco.MjSpec.from_string(text)
    renamed.modelfiledir = spec.modelfiledir
    return renamed


def prefix_line(path: Path) -> str:
    """Return the note on a prefix that `read_spec` removes, '' if there is none."""
    prefix = _common_prefix(_read(path), path)
    return f"all names in {path.name} begin with '{prefix}', which is left out" if prefix else ""


def _read(path: Path) -> mujoco.MjSpec:
    regular_file(path, "the robot's MJCF model")
    kind = "URDF" if path.suffix == ".urdf" else "MJCF model"
    with blaming(f"{path}: not a valid {kind}", (ValueError, *_NO_ROOM)), mujoco_silenced:
        return mujoco.MjSpec.from_file(str(path))


def _common_prefix(spec: mujoco.MjSpec, path: Path) -> str:
    """Return what the names of all joints, and of the bodies that have them, begin with up to a slash; '' mostly.

    A file that includes others keeps its names: they are in several texts.
    """
    parts = {name[: name.find("/") + 1] for joint in spec.joints for name in (joint.name, joint.parent.name) if name}
    prefix = parts.pop() if len(parts) == 1 else ""
    return prefix if prefix and path.suffix == ".xml" and "<include" not in path.read_text(encoding="utf-8") else ""


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Compile; `path` is what to call it in messages. Raises `InputError` where that fails."""
    with blaming(f"{path}: does not compile", (ValueError, *_NO_ROOM)), mujoco_silenced:
        model = spec.compile()
    for name in _FINITE:
        values = getattr(model, name)
        if not (np.abs(values) <= mujoco.mjMAXVAL).all():  # written so that NaN fails it
            what, _, field = name.partition("_")
            bad = int(np.argwhere(~(np.abs(values) <= mujoco.mjMAXVAL))[0][0])
            owner = f"{what} {bad} '{getattr(model, _OWNER[what])(bad).name}'"
            raise InputError(f"{path}: {owner}: {field} is {values[bad]}, expected numbers within ±{mujoco.mjMAXVAL:g}")
    return model


def describe_mjcf(path: Path) -> RobotDescription:
    """Describe the robot in an MJCF file; its IMU is what `find_imu` finds.

    Raises `InputError` if it is not an MJCF, has no hinge joints, or lacks names of joints or base.
    """
    spec = read_spec(path)
    model = compile_spec(spec, path)
    joints = _joints(model)
    if not joints:
        raise InputError(f"{path}: has no hinge joint, expected a robot")
    for joint in joints:
        if not model.joint(joint).name:
            body = model.body(model.jnt_bodyid[joint]).name
            raise InputError(f"{path}: the joint of body '{body}' has no name; policies find joints by name")
    base = _root(model, joints[0])
    if not model.body(base).name:
        raise InputError(f"{path}: the body that carries '{model.joint(joints[0]).name}' has no name; it is the base")
    is_floating = _has_free_joint(model, base)
    n = len(joints)
    limited = model.jnt_limited[joints].astype(bool)  # the others turn freely
    lower = np.where(limited, model.jnt_range[joints, 0], -math.inf)
    upper = np.where(limited, model.jnt_range[joints, 1], math.inf)
    pose = tuple(float(q) for q in np.clip(model.qpos0[model.jnt_qposadr[joints]], lower, upper))
    standby = StandbySettings(
        target_stiffness=(0.0,) * n,
        target_damping=(0.0,) * n,
        segment_durations=(_STANDBY_SECONDS,),
        pose_segments=(pose,),
    )
    efforts = _effort_limits(model, joints)
    return RobotDescription(
        name=spec.modelname if spec.modelname not in ("", _UNNAMED) else path.stem,
        mjcf=path.name,
        folder=str(path.resolve().parent),
        joints=tuple(
            JointDescription(
                name=model.joint(joint).name,
                lower=float(lower[i]),
                upper=float(upper[i]),
                effort_limit=efforts[i],
                stiffness=0.0,
                damping=0.0,
            )
            for i, joint in enumerate(joints)
        ),
        initial_position=pose,
        imu=find_imu(model, base)[0],
        base=BaseSettings(type="floating", body=model.body(base).name) if is_floating else BaseSettings(),
        simulation=_simulation(model, is_floating),
        damping_controller=DampingSettings(damping_scalar=0.0),
        standby_controller_a=standby,
        standby_controller_b=standby,
    )


def bare_model(description: RobotDescription) -> mujoco.MjModel:
    """Return the robot's MJCF as it is, compiled.

    Raises `InputError` if it cannot be read, or lacks a joint, or the IMU, of the description.
    """
    path = description.mjcf_path
    model = compile_spec(read_spec(path), path)
    known = [model.joint(i).name for i in range(model.njnt)]
    require_known("joint", description.joint_names, known, f"{path}: ")
    frames = [model.site(i).name for i in range(model.nsite)] + [model.body(i).name for i in range(1, model.nbody)]
    named = [name for name in frames if name]
    require_known("site or body", [description.imu], named, f"{path}: imu of '{description.name}': ")
    return model


def own_joint_damping(model: mujoco.MjModel, description: RobotDescription) -> Mapping[str, float]:
    """Return damping in N·m·s/rad that a `bare_model` itself gives the joints, by name, where it gives any."""
    damping = {name: float(model.dof_damping[model.joint(name).dofadr[0]]) for name in description.joint_names}
    return {name: value for name, value in damping.items() if value}


def _joints(model: mujoco.MjModel) -> list[int]:
    hinges = [i for i in range(model.njnt) if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE]
    if model.nu == 0:
        floating = [i for i in hinges if _has_free_joint(model, _root(model, i))]
        return floating or hinges  # doors and other furniture have hinges too
    driven = {int(model.actuator_trnid[i, 0]) for i in _on_joints(model)}
    return [i for i in hinges if i in driven]


def _root(model: mujoco.MjModel, joint: int) -> int:
    return int(model.body_rootid[model.jnt_bodyid[joint]])


def _has_free_joint(model: mujoco.MjModel, body: int) -> bool:
    joint = int(model.body_jntadr[body])
    return joint >= 0 and bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE)


def own_actuators(model: mujoco.MjModel) -> dict[str, OwnActuator]:
    """Return what the model's own actuators do to each joint that they drive, by the joint's name."""
    found: dict[str, OwnActuator] = {}
    for i in _on_joints(model):
        actuator = _own_actuator(model, i)
        other = found.get(actuator.joint)
        found[actuator.joint] = actuator if other is None else _together(other, actuator)
    return found


def _on_joints(model: mujoco.MjModel) -> list[int]:
    """Actuators that drive a joint."""
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return [i for i in range(model.nu) if int(model.actuator_trntype[i]) in kinds]


def _own_actuator(model: mujoco.MjModel, i: int) -> OwnActuator:
    joint, gear = model.joint(int(model.actuator_trnid[i, 0])), float(model.actuator_gear[i, 0])
    gain = float(model.actuator_gainprm[i, 0])
    rest, stiffness, damping = (0.0 - float(value) for value in model.actuator_biasprm[i, :3])
    has_plain_gain = model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED
    bias = mujoco.mjtBias(int(model.actuator_biastype[i]))
    force = _range(model.actuator_forcerange[i] * gear, bool(model.actuator_forcelimited[i]))
    control = _range(model.actuator_ctrlrange[i], bool(model.actuator_ctrllimited[i]))
    if has_plain_gain and bias == mujoco.mjtBias.mjBIAS_AFFINE:
        target = NO_RANGE
        if stiffness * gear:  # the target of a servo is where it is without force
            target = _range((gain * np.array(control) - rest) / (stiffness * gear), True)
        return OwnActuator(joint.name, "servo", stiffness * gear**2, damping * gear**2, force, target)
    if has_plain_gain and bias == mujoco.mjtBias.mjBIAS_NONE and not model.actuator_dyntype[i]:
        by_control = _range(np.array(control) * gain * gear, True)  # the control is the force
        force = (max(force[0], by_control[0]), min(force[1], by_control[1]))
        return OwnActuator(joint.name, "motor", 0.0, 0.0, force, NO_RANGE)
    return OwnActuator(joint.name, "other", 0.0, 0.0, force, NO_RANGE)


def _range(values: FloatArray, is_limited: bool) -> tuple[float, float]:
    return (float(min(values)), float(max(values))) if is_limited else NO_RANGE


def _together(one: OwnActuator, other: OwnActuator) -> OwnActuator:
    """Several actuators of one joint, such as one of its position and one of its velocity."""
    leading = max((one, other), key=lambda actuator: actuator.stiffness)
    return replace(
        leading,
        stiffness=one.stiffness + other.stiffness,
        damping=one.damping + other.damping,
        force_range=(one.force_range[0] + other.force_range[0], one.force_range[1] + other.force_range[1]),
    )


def _effort_limits(model: mujoco.MjModel, joints: list[int]) -> list[float]:
    """N·m: the least of what the joint and its actuators allow, infinite where neither says."""
    own, limits = own_actuators(model), []
    for joint in joints:
        actuator = own.get(model.joint(joint).name)
        limit = math.inf if actuator is None else max(abs(bound) for bound in actuator.force_range)
        if model.jnt_actfrclimited[joint]:
            limit = min(limit, float(np.abs(model.jnt_actfrcrange[joint]).max()))
        limits.append(limit)
    return limits


def _simulation(model: mujoco.MjModel, is_floating: bool) -> SimulationSettings:
    """Return the MJCF's own step, unless it is too long or does not divide the control period."""
    longest = _LONGEST_TIMESTEP["floating" if is_floating else "fixed"]
    own = float(model.opt.timestep)
    try:
        steps_per_period(1.0 / SimulationSettings().control_frequency, own)
    except InputError:
        own = longest
    return SimulationSettings(physics_timestep=min(own, longest))


_GYRO = (mujoco.mjtSensor.mjSENS_GYRO,)
_FRAME = (
    mujoco.mjtSensor.mjSENS_ACCELEROMETER,
    mujoco.mjtSensor.mjSENS_VELOCIMETER,
    mujoco.mjtSensor.mjSENS_FRAMEQUAT,
    mujoco.mjtSensor.mjSENS_FRAMEXAXIS,
    mujoco.mjtSensor.mjSENS_FRAMEYAXIS,
    mujoco.mjtSensor.mjSENS_FRAMEZAXIS,
    mujoco.mjtSensor.mjSENS_FRAMEANGVEL,
    mujoco.mjtSensor.mjSENS_FRAMELINACC,
)
"""Sensors of an orientation, or of how it moves; those of positions alone are often a foot's."""


def find_imu(model: mujoco.MjModel, base: int) -> tuple[str, str]:
    """Return the site or body that is the IMU of the robot with this base, and why.

    In this order: the site of a gyro on the base, or of the only gyro on the robot; a site of the base named like an
    IMU; the only site on the robot with a sensor of an orientation; the base itself.
    """
    gyros, frames = _sites(model, base, _GYRO), _sites(model, base, _FRAME)
    named = [
        i
        for i in range(model.nsite)
        if model.body_rootid[model.site_bodyid[i]] == base and "imu" in model.site(i).name.lower()
    ]
    for sites, what in ((_on(model, base, gyros), "a gyro"), (gyros if len(gyros) == 1 else [], "the only gyro")):
        if sites:
            return model.site(sites[0]).name, f"the site of {what}"
    if _on(model, base, named):
        return model.site(_on(model, base, named)[0]).name, "a site of the base named like an IMU"
    if len(frames) == 1:
        return model.site(frames[0]).name, "the only site with a sensor of its orientation"
    others = list(dict.fromkeys(model.site(i).name for i in (*gyros, *frames, *named)))
    elsewhere = f"; other sites could be it: {', '.join(others)}" if others else ""
    return model.body(base).name, f"no site of the model is clearly the IMU{elsewhere}"


def _sites(model: mujoco.MjModel, base: int, kinds: Sequence[mujoco.mjtSensor]) -> list[int]:
    """Named sites of the robot that have such a sensor, once each."""
    found = []
    for i in range(model.nsensor):
        if mujoco.mjtSensor(int(model.sensor_type[i])) in kinds and model.sensor_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
            site = int(model.sensor_objid[i])
            is_ours = model.body_rootid[model.site_bodyid[site]] == base
            if is_ours and model.site(site).name and site not in found:
                found.append(site)
    return found


def _on(model: mujoco.MjModel, base: int, sites: list[int]) -> list[int]:
    return [site for site in sites if model.site_bodyid[site] == base]


def imu_line(model: mujoco.MjModel, description: RobotDescription) -> str:
    """Give which frame of a robot's model is its IMU, on which body, and why that one; the model has what it names."""
    base = int(model.body_rootid[model.jnt_bodyid[model.joint(description.joints[0].name).id]])
    name, (found, why) = description.imu, find_imu(model, base)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    body = int(model.site_bodyid[site]) if site >= 0 else mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    owner, root = model.body(body).name, model.body(base).name
    reason = why if name == found else "as it was given"
    if site < 0:
        where = f"the base '{owner}' itself" if body == base else f"body '{owner}', not the base '{root}'"
    else:
        where = f"site '{name}' on " + (f"the base '{owner}'" if body == base else f"'{owner}', not the base '{root}'")
    return f"{where} ({reason})"
