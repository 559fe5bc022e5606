"""Directions of joints, judged in a recording: efforts at rest against the torque that gravity needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import conjugate, rotate
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.reader import Recording
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import bodies_above, build_model, joint_addresses, named_frame

_DOWN = np.array([0.0, 0.0, -9.81])  # m/s²
_REST = 1.0  # s that a rest lasts; the efforts of its second half count
_MOVED, _COMMANDED = 0.02, 1e-3  # rad by which positions and commands differ at most in a rest
_FRICTION, _SHARE = 0.3, 0.15  # N·m, and share of the expected torque, by which a sound joint differs from its model
_AT_STOP, _IMPOSSIBLE = 0.03, 0.1  # rad before a limit, where the stop may carry the joint; beyond it, where none is
_VISIBLE = 1.0  # misfit, in tolerances squared, by which a mirrored joint would show
_EXPLAINED = 0.1  # share of a limb's misfit that an explanation may leave


class JointSign(NamedTuple):
    """Verdict on one joint, with its efforts, N·m, in the rest in which they differ most."""

    joint: str
    measured: float
    expected: float
    verdict: str


def judge_signs(recording: Recording, description: RobotDescription) -> list[JointSign]:
    """Judge every joint of a recorded robot, in its order.

    In each limb the one mirrored joint that explains what contradicts gravity is named. Raises `InputError` if the
    robot never rested while it was held.
    """
    position, effort, imu = _rests(recording, description)
    model, names = build_model(description, scene=False), description.joint_names
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    sound, expected = _misfit(description, model, position, effort, imu)
    signs = 1.0 - 2.0 * np.eye(len(names))
    mirrored = np.array([_misfit(description, model, one * position, one * effort, imu)[0] for one in signs])
    verdicts = [""] * len(names)
    for limb in _limbs(model, names):
        left = mirrored[np.ix_(limb, limb)].sum(axis=1)  # misfit of the limb, by the joint that is mirrored
        best, is_explained = limb[left.argmin()], left.min() <= _EXPLAINED * sound[limb].sum()
        for i, misfit in zip(limb, left.tolist(), strict=True):
            if sound[i] == 0.0:
                verdicts[i] = "agrees" if misfit > _VISIBLE else "agrees, as it would mirrored"
            elif not is_explained:
                verdicts[i] = "contradicts: zero, load or contact?"
            else:
                verdicts[i] = f"contradicts: {'direction wrong?' if i == best else f'explained by {names[best]}'}"
    worst = np.abs(effort - expected).argmax(axis=0), np.arange(len(names))
    rows = zip(names, effort[worst].tolist(), expected[worst].tolist(), verdicts, strict=True)
    return [JointSign(*row) for row in rows]


def _limbs(model: mujoco.MjModel, names: Sequence[str]) -> list[list[int]]:
    """Return the indices of the joints that hang on the base together."""
    bodies = [int(model.joint(name).bodyid[0]) for name in names]
    roots = [next(above for above in reversed(bodies_above(model, body)) if above in bodies) for body in bodies]
    return [[i for i, other in enumerate(roots) if other == root] for root in dict.fromkeys(roots)]


def _rests(recording: Recording, description: RobotDescription) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions and efforts, (k, n), rad and N·m, and the IMU's quaternions, (k, 4), of the seconds at rest."""
    # On its feet, as a floating base is in the other modes, a robot's legs carry what no model tells apart.
    held = (Mode.STANDBY,) if description.is_floating else (Mode.STANDBY, Mode.LOCOMOTION, Mode.REMOTE)
    run, count = recording.arrays(), round(_REST / recording.header.control_period)
    found = []
    for start in range(0, len(run["time"]) - count + 1, max(count // 10, 1)):
        whole, half = slice(start, start + count), slice(start + count // 2, start + count)
        position, effort = run["position"][whole], run["effort"][half]
        is_still = (np.ptp(position, axis=0) <= _MOVED).all()
        is_held = (
            np.isin(run["mode"][whole], held).all()
            and (np.ptp(run["command_position"][whole], axis=0) <= _COMMANDED).all()
        )
        if is_still and is_held and np.isfinite(effort).all():
            found.append(
                (run["position"][half].mean(axis=0), effort.mean(axis=0), run["imu_quaternion"][start + count - 1])
            )
    if not found:
        modes = " or ".join(mode.name for mode in held)
        raise InputError(f"{recording.path}: the robot never rested for {_REST:g} s in {modes}")
    position, effort, imu = (np.array(column) for column in zip(*found, strict=True))
    return position, effort, imu


def _misfit(
    description: RobotDescription, model: mujoco.MjModel, position: FloatArray, effort: FloatArray, imu: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return misfits, (n,), and expected torques, (k, n), N·m, of k rests.

    A misfit is the mean square of what is beyond the tolerance, in tolerances.
    """
    expected = _torques(description, model, position, imu)
    beyond = np.abs(effort - expected) / (_FRICTION + _SHARE * np.abs(expected)) - 1.0
    lower, upper = description.lower, description.upper
    is_free = (position > lower + _AT_STOP) & (position < upper - _AT_STOP)
    is_impossible = (position < lower - _IMPOSSIBLE) | (position > upper + _IMPOSSIBLE)
    beyond = np.where(is_free, np.maximum(beyond, 0.0), np.where(is_impossible, np.inf, 0.0))
    return np.square(beyond).mean(axis=0), expected


def _torques(description: RobotDescription, model: mujoco.MjModel, position: FloatArray, imu: FloatArray) -> FloatArray:
    """Return the torques, (k, n), N·m, that hold the model in k poses, rad; a floating base as its IMU says."""
    data, addresses, torques = mujoco.MjData(model), joint_addresses(model, description.joint_names), []
    for pose, quaternion in zip(position, imu, strict=True):
        data.qpos[addresses.qpos] = pose
        if description.is_floating:  # gravity turns about the robot, so that its IMU reads what was recorded
            mujoco.mj_kinematics(model, data)
            kind, i = named_frame(model, description.imu, "imu")
            matrices = data.site_xmat if kind == mujoco.mjtObj.mjOBJ_SITE else data.xmat
            model.opt.gravity[:] = matrices[i].reshape(3, 3) @ rotate(conjugate(quaternion), _DOWN)
        mujoco.mj_forward(model, data)
        torques.append((data.qfrc_bias - data.qfrc_passive)[addresses.dof])
    return np.array(torques)
