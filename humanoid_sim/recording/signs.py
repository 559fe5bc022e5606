"""Directions of joints, judged in a recording: efforts at rest against the torque that gravity needs."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import conjugate, multiply, quaternion_from_matrix
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.reader import Recording
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.model import bodies_above, build_model, joint_addresses, named_frame

_LEAST = 1.0  # s that a rest lasts at least; the efforts of its second half count
_MOVED, _COMMANDED = 0.02, 1e-3  # rad by which positions and commands differ at most in a rest
_FRICTION, _SHARE = 0.3, 0.15  # N·m, and share of the expected torque, by which a sound joint differs from its model
_AT_STOP, _IMPOSSIBLE = 0.03, 0.1  # rad before a limit, where the stop may carry the joint; beyond it, where none is
_VISIBLE = 1.0  # misfit, in tolerances squared, by which a mirrored joint would show
_EXPLAINED = 0.1  # share of a limb's misfit that an explanation may leave


@dataclass(frozen=True, slots=True)
class JointSign:
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
    gravity = _Gravity(description, _rests(recording, description))
    sound, verdicts = gravity.misfit(None), [""] * description.joint_count
    for limb in gravity.limbs:
        mirrored = {i: gravity.misfit(i)[limb].sum() for i in limb}
        best = min(mirrored, key=lambda i: mirrored[i])
        is_explained = mirrored[best] <= _EXPLAINED * sound[limb].sum()
        for i in limb:
            if sound[i] > 0.0 and is_explained:
                culprit = description.joint_names[best]
                verdicts[i] = f"contradicts: {'direction wrong?' if i == best else f'explained by {culprit}'}"
            elif sound[i] > 0.0:
                verdicts[i] = "contradicts: zero, load or contact?"
            else:
                verdicts[i] = "agrees" if mirrored[i] > _VISIBLE else "too small to say"
    expected = gravity.torque(gravity.position)
    worst = np.abs(gravity.effort - expected).argmax(axis=0)
    return [
        JointSign(name, float(gravity.effort[k, i]), float(expected[k, i]), verdict)
        for i, (name, k, verdict) in enumerate(zip(description.joint_names, worst, verdicts, strict=True))
    ]


def _rests(recording: Recording, description: RobotDescription) -> list[list[TickRecord]]:
    """Return the second halves of the stretches at rest."""
    # On its feet, as a floating base is in the other modes, a robot's legs carry what no model tells apart.
    held = (Mode.STANDBY,) if description.is_floating else (Mode.STANDBY, Mode.LOCOMOTION, Mode.REMOTE)
    rests: list[list[TickRecord]] = [[]]
    for tick in recording.ticks():
        if tick.output.control_mode.mode not in held or not np.isfinite(tick.input.state.joint_effort).all():
            rests.append([])
            continue
        first = rests[-1][0] if rests[-1] else tick
        moved = np.abs(tick.input.state.joint_position - first.input.state.joint_position)
        commanded = np.abs(tick.output.command.position - first.output.command.position)
        if not ((moved <= _MOVED).all() and (commanded <= _COMMANDED).all()):
            rests.append([])
        rests[-1].append(tick)
    least = _LEAST / recording.header.control_period
    found = [rest[len(rest) // 2 :] for rest in rests if len(rest) >= least]
    if not found:
        modes = " or ".join(mode.name for mode in held)
        raise InputError(f"{recording.path}: the robot never rested for {_LEAST:g} s in {modes}")
    return found


class _Gravity:
    """Efforts of k rests, (k, n), N·m, and the torque that holds the robot's model in their poses."""

    def __init__(self, description: RobotDescription, rests: list[list[TickRecord]]) -> None:
        states = [[tick.input.state for tick in rest] for rest in rests]
        self.position = np.array([np.mean([state.joint_position for state in rest], axis=0) for rest in states])
        self.effort = np.array([np.mean([state.joint_effort for state in rest], axis=0) for rest in states])
        self._imu = [rest[-1].imu_quaternion for rest in states]
        self._model = model = build_model(description, scene=False)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self._data = mujoco.MjData(model)
        self._addresses = joint_addresses(model, description.joint_names)
        self._base = base_addresses(model, description)[1] if description.is_floating else None
        self._frame = named_frame(model, description.imu, "imu")
        self._lower, self._upper = description.lower, description.upper
        bodies = [int(model.joint(name).bodyid[0]) for name in description.joint_names]
        roots = [next(b for b in reversed(bodies_above(model, body)) if b in bodies) for body in bodies]
        self.limbs = [[i for i, other in enumerate(roots) if other == root] for root in dict.fromkeys(roots)]
        """Indices of the joints that hang on the base together."""

    def torque(self, position: FloatArray) -> FloatArray:
        """Shape (k, n), N·m, of poses (k, n), rad."""
        return np.array([self._hold(*pose) for pose in zip(position, self._imu, strict=True)])

    def _hold(self, position: FloatArray, imu: FloatArray) -> FloatArray:
        model, data = self._model, self._data
        data.qpos[self._addresses.qpos] = position
        if self._base is not None:  # rotated so that the model's IMU reads what was recorded
            data.qpos[self._base] = 1.0, 0.0, 0.0, 0.0
            mujoco.mj_kinematics(model, data)
            kind, i = self._frame
            matrices = data.site_xmat if kind == mujoco.mjtObj.mjOBJ_SITE else data.xmat
            data.qpos[self._base] = multiply(imu, conjugate(quaternion_from_matrix(matrices[i].reshape(3, 3))))
        mujoco.mj_forward(model, data)
        torque: FloatArray = (data.qfrc_bias - data.qfrc_passive)[self._addresses.dof]
        return torque

    def misfit(self, mirrored: int | None) -> FloatArray:
        """Shape (n,): squares of what is beyond the tolerance, in tolerances, averaged, if one joint is mirrored."""
        position, effort = self.position.copy(), self.effort.copy()
        if mirrored is not None:
            position[:, mirrored] *= -1.0
            effort[:, mirrored] *= -1.0
        expected = self.torque(position)
        beyond = np.abs(effort - expected) / (_FRICTION + _SHARE * np.abs(expected)) - 1.0
        is_free = (position > self._lower + _AT_STOP) & (position < self._upper - _AT_STOP)
        is_impossible = (position < self._lower - _IMPOSSIBLE) | (position > self._upper + _IMPOSSIBLE)
        beyond = np.where(is_free, np.maximum(beyond, 0.0), np.where(is_impossible, np.inf, 0.0))
        misfit: FloatArray = np.square(beyond).mean(axis=0)
        return misfit
