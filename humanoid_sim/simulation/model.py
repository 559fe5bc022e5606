"""From a robot description to a compiled MuJoCo model, and from names to addresses in it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.mit import IndexArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.mjcf import compile_spec, read_spec
from humanoid_sim.robots.piano import key_joint_names
from humanoid_sim.robots.schema import steps_per_period
from humanoid_sim.simulation.scene import add_floor, add_scene

IMPLICIT_TIMESTEP = 0.0025  # s, physics step of implicit damping, unless another is given or the robot's own is longer

UNSOUND = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADCTRL) + 1)
"""MuJoCo's warnings of a state that is not finite, or huge: of qpos, qvel, qacc, ctrl."""
SUPPORT = "humanoid_sim_support"
"""Name of the mocap body and of the weld that can hold a base: unlikely enough to be in any user's MJCF."""
_SCALAR_JOINTS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(frozen=True, slots=True)
class SimConfig:
    """Settings of a simulated robot, or of each in a batch."""

    control_period: float | None = None  # s; None for the description's
    physics_timestep: float | None = None
    """s, divides the control period; None for the description's, or `IMPLICIT_TIMESTEP`."""
    support: bool = True  # start a floating base held; of one robot only
    drop: float = 0.0  # m, by which a held base hangs above its feet
    anchor_body: str = ""  # MJCF body whose pose the state has as `anchor_pose`; empty for none
    velocity_at: tuple[str, ...] = ()  # `imu`, or MJCF sites, whose velocity the state of a floating base's robot has
    height_scan: HeightScan | None = None  # of the ground, which the state then has
    bodies: tuple[str, ...] = ()  # MJCF bodies whose poses `body_poses` gives

    def period(self, description: RobotDescription) -> float:
        """Return the control period, s."""
        own = 1.0 / description.simulation.control_frequency
        return own if self.control_period is None else self.control_period

    def timestep(self, description: RobotDescription, *, implicit: bool = False) -> float:
        """Return the physics step, s."""
        if self.physics_timestep is not None:
            return self.physics_timestep
        own = description.simulation.physics_timestep
        return max(own, IMPLICIT_TIMESTEP) if implicit else own

    def physics_steps(self, description: RobotDescription, *, implicit: bool = False) -> int:
        """Return the physics steps in a control period. Raises `InputError` if it is no whole number."""
        return steps_per_period(self.period(description), self.timestep(description, implicit=implicit))


@dataclass(frozen=True, slots=True, eq=False)
class JointAddresses:
    """Indices of n joints in `qpos`, and in `qvel` and `qfrc_applied`, in the order in which they were requested."""

    qpos: IndexArray
    dof: IndexArray

    @property
    def slices(self) -> tuple[slice, slice] | None:
        """The two as slices, which make views; None where the joints are not adjacent and in order."""
        if not all((np.diff(index) == 1).all() for index in (self.qpos, self.dof)):
            return None
        return slice(self.qpos[0], self.qpos[-1] + 1), slice(self.dof[0], self.dof[-1] + 1)


def build_model(
    description: RobotDescription,
    *,
    physics_timestep: float | None = None,
    affine_actuators: bool = False,
    implicit: bool = False,
    scene: bool | Literal["floor"] = True,
    sensors: SimConfig | None = None,
) -> mujoco.MjModel:
    """Return the robot in a room, ready for the MIT law.

    The MJCF loses its own actuators, the sensors of them, and its keyframes. Joint and effort limits are the
    description's, which also says whether joints keep damping of their own. Joints that the description does not have
    stay passive. No automatic reset of a bad state. A floating base gets a support, see `floating_base`. Raises
    `InputError` if the MJCF cannot be read, or lacks what the description names.

    Args:
        physics_timestep: s; None for the description's.
        affine_actuators: add one actuator per joint, in order, of force `ctrl - K_p q - K_d qd` saturated at the effort
            limit; the gains start at 0.
        implicit: integrate damping implicitly (`implicitfast`), that of the affine actuators too; else Euler.
        scene: add floor, light and sky; or only the floor, for models that nobody looks at.
        sensors: add the sensors that `sensing.Sensors` reads for these settings.
    """
    spec = read_spec(description.mjcf_path)
    driven = [sensor for sensor in spec.sensors if mujoco.mjtObj.mjOBJ_ACTUATOR in (sensor.objtype, sensor.reftype)]
    for element in (*driven, *spec.actuators, *spec.keys):
        spec.delete(element)
    with blaming(f"{description.mjcf_path}: not a valid MJCF model", ValueError):
        _check_names(description, spec)
    spec.option.timestep = description.simulation.physics_timestep if physics_timestep is None else physics_timestep
    kinds = mujoco.mjtIntegrator
    spec.option.integrator = kinds.mjINT_IMPLICITFAST if implicit else kinds.mjINT_EULER
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    if description.is_floating:
        _add_support(spec, description.base.body)
    if affine_actuators:
        _add_affine_actuators(spec, description)
    if scene:
        bare = compile_spec(spec, description.mjcf_path)
        (add_floor if scene == "floor" else add_scene)(spec, bare, description)
    if sensors is not None:
        from humanoid_sim.simulation.sensing import add_sensors  # noqa: PLC0415 - which finds addresses in models

        add_sensors(spec, description, sensors)
    model = compile_spec(spec, description.mjcf_path)
    _set_joints(model, description)
    return model


def model_bytes(model: mujoco.MjModel) -> bytes:
    """Return the compiled model as MuJoCo stores it (`.mjb`), for the same version of MuJoCo to load."""
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def joint_addresses(model: mujoco.MjModel, names: Sequence[str]) -> JointAddresses:
    """Addresses of hinge and slide joints by name. Raises `InputError` for others, listing those that there are."""
    known = [
        model.joint(i).name for i in range(model.njnt) if mujoco.mjtJoint(int(model.jnt_type[i])) in _SCALAR_JOINTS
    ]
    require_known("joint", names, known)
    ids = [model.joint(name).id for name in names]
    return JointAddresses(model.jnt_qposadr[ids].astype(np.intp), model.jnt_dofadr[ids].astype(np.intp))


def base_body(model: mujoco.MjModel, description: RobotDescription) -> int:
    """Id of the body that holds the robot's first joint's kinematic tree: the chest of the Lite."""
    return bodies_above(model, int(model.jnt_bodyid[model.joint(description.joints[0].name).id]))[-1]


def bodies_above(model: mujoco.MjModel, body: int) -> list[int]:
    """Return a body and all that carry it, but for the world, from the body on."""
    chain = []
    while body:
        chain.append(body)
        body = int(model.body_parentid[body])
    return chain


def breadth_first(model: mujoco.MjModel, root: int = 0) -> list[int]:
    """Return the bodies from `root` on level by level through the kinematic tree, siblings as the MJCF lists them."""
    depth = {root: 0}
    for body in range(root + 1, model.nbody):
        parent = int(model.body_parentid[body])
        if parent in depth:
            depth[body] = depth[parent] + 1
    # Among bodies of the same depth the children of the first come first: the MJCF's own order. The sort is stable.
    return sorted(depth, key=lambda body: depth[body])


def joints_of(model: mujoco.MjModel, bodies: Iterable[int], names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the joints of bodies, in the order of these, that are among `names`."""
    found: list[str] = []
    for body in bodies:
        first = int(model.body_jntadr[body])
        found += [model.joint(joint).name for joint in range(first, first + int(model.body_jntnum[body]))]
    return tuple(name for name in found if name in names)


def body_ids(model: mujoco.MjModel, names: Sequence[str]) -> tuple[int, ...]:
    """Ids of bodies by name. Raises `InputError` for others, listing those that there are."""
    require_known("body", names, [model.body(i).name for i in range(1, model.nbody)])
    return tuple(int(model.body(name).id) for name in names)


def named_frame(model: mujoco.MjModel, name: str, what: str) -> tuple[mujoco.mjtObj, int]:
    """Return kind and id of the site, or else the body, of that name. Raises `InputError` if there is neither."""
    for kind in (mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_XBODY):  # mjOBJ_BODY is the frame of the inertia
        i = mujoco.mj_name2id(model, kind, name)
        if i >= 0:
            return kind, i
    raise InputError(f"{what}: '{name}' is neither a site nor a body of the model")


def _check_names(description: RobotDescription, spec: mujoco.MjSpec) -> None:
    joints = [joint.name for joint in spec.joints if joint.type in _SCALAR_JOINTS]
    bodies = [body.name for body in spec.bodies if body.name]
    sites = [site.name for site in spec.sites if site.name]
    checks = [
        ("joint", "joints", description.joint_names, joints),
        ("body", "hands", description.hands, bodies),
        ("site or body", "imu", [description.imu], [*sites, *bodies]),
    ]
    if description.is_floating:
        free = [joint.parent.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
        checks.append(("body with a free joint", "base.body", [description.base.body], free))
    if description.piano is not None:
        checks.append(("joint", "piano", key_joint_names(), joints))
        checks.append(("site", "piano.fingers", description.piano.fingers, sites))
    for kind, field, names, known in checks:
        require_known(kind, names, known, f"{description.mjcf_path}: {field} of '{description.name}': ")


def _add_support(spec: mujoco.MjSpec, body: str) -> None:
    """Add what can hold the base: a weld, at first inactive, to a mocap body that nothing pushes away."""
    spec.worldbody.add_body(name=SUPPORT, mocap=True)
    weld = spec.add_equality(name=SUPPORT, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, active=False)
    weld.name1, weld.name2 = SUPPORT, body
    # anchor at the origin, no offset between the two frames, torques weighed as forces at 1 m
    weld.data = [*[0.0] * 6, 1.0, *[0.0] * 3, 1.0, 0.0]


def _add_affine_actuators(spec: mujoco.MjSpec, description: RobotDescription) -> None:
    limited, unlimited = mujoco.mjtLimited.mjLIMITED_TRUE, mujoco.mjtLimited.mjLIMITED_FALSE
    for joint, scale in zip(description.joints, description.torque_scale.tolist(), strict=True):
        actuator = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm[0] = 1.0
        actuator.forcelimited = unlimited
        if math.isfinite(joint.effort_limit):
            limit = scale * joint.effort_limit
            actuator.forcelimited, actuator.forcerange = limited, [-limit, limit]


def _set_joints(model: mujoco.MjModel, description: RobotDescription) -> None:
    """Set limits and dynamics on the compiled model, where angles are radians: a spec in degrees would shrink them.

    The joint's own force range goes: the law saturates at the description's effort limit.
    """
    for joint in description.joints:
        i = model.joint(joint.name).id
        dof = int(model.jnt_dofadr[i])
        model.jnt_limited[i] = math.isfinite(joint.lower) or math.isfinite(joint.upper)
        if model.jnt_limited[i]:
            model.jnt_range[i] = joint.lower, joint.upper
        model.jnt_actfrclimited[i] = 0
        if description.simulation.joint_damping == "drop":
            model.dof_damping[dof] = 0.0
        if joint.dynamics is None:
            continue
        measured = joint.dynamics.armature, joint.dynamics.friction, joint.dynamics.damping
        for values, value in zip(
            (model.dof_armature, model.dof_frictionloss, model.dof_damping), measured, strict=True
        ):
            if value is not None:
                values[dof] = value
    if any(joint.dynamics is not None for joint in description.joints):
        mujoco.mj_setConst(model, mujoco.MjData(model))  # the inertias seen by constraints
