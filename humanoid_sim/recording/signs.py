"""Directions of joints, judged in a recording: efforts at rest against the torque that gravity needs."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import conjugate, rotate
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.reader import Recording
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import bodies_above, build_model, joint_addresses, named_frame

_LEAST = 1.0  # s that a rest lasts at least; the efforts of its second half count
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
    gravity = _Gravity(description, _rests(recording, description))
    sound, verdicts = gravity.misfit(None), [""] * description.joint_count
    for limb in gravity.limbs:
        mirrored = {i: gravity.misfit(i)[limb].sum() for i in limb}
        best = min(mirrored, key=lambda i: mirrored[i])
        is_explained = mirrored[best] <= _EXPLAINED * sound[limb].sum()
        for i in limb:
            if sound[i] == 0.0:
                verdicts[i] = "agrees" if mirrored[i] > _VISIBLE else "too small to say"
            elif not is_explained:
                verdicts[i] = "contradicts: zero, load or contact?"
            elif i == best:
                verdicts[i] = "contradicts: direction wrong?"
            else:
                verdicts[i] = f"contradicts: explained by {description.joint_names[best]}"
    expected = gravity.torque(gravity.position)
    worst = np.abs(gravity.effort - expected).argmax(axis=0), np.arange(description.joint_count)
    columns = description.joint_names, gravity.effort[worst].tolist(), expected[worst].tolist(), verdicts
    return [JointSign(*row) for row in zip(*columns, strict=True)]


def _rests(recording: Recording, description: RobotDescription) -> list[list[TickRecord]]:
    """Return the second halves of the stretches at rest."""
    # On its feet, as a floating base is in the other modes, a robot's legs carry what no model tells apart.
    held = (Mode.STANDBY,) if description.is_floating else (Mode.STANDBY, Mode.LOCOMOTION, Mode.REMOTE)
    rests: list[list[TickRecord]] = [[]]
    for tick in recording.ticks():
        state, command = tick.input.state, tick.output.command
        if tick.output.control_mode.mode not in held or not np.isfinite(state.joint_effort).all():
            rests.append([])
            continue
        first = rests[-1][0] if rests[-1] else tick
        moved = np.abs(state.joint_position - first.input.state.joint_position)
        commanded = np.abs(command.position - first.output.command.position)
        if not ((moved <= _MOVED).all() and (commanded <= _COMMANDED).all()):
            rests.append([])
        rests[-1].append(tick)
    found = [rest[len(rest) // 2 :] for rest in rests if len(rest) >= _LEAST / recording.header.control_period]
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
        self._description = description
        self._model = model = build_model(description, scene=False)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self._data, self._down = mujoco.MjData(model), model.opt.gravity.copy()
        self._addresses = joint_addresses(model, description.joint_names)
        self._frame = named_frame(model, description.imu, "imu") if description.is_floating else None
        bodies = [int(model.joint(name).bodyid[0]) for name in description.joint_names]
        roots = [next(b for b in reversed(bodies_above(model, body)) if b in bodies) for body in bodies]
        self.limbs = [[i for i, other in enumerate(roots) if other == root] for root in dict.fromkeys(roots)]
        """Indices of the joints that hang on the base together."""

    def torque(self, position: FloatArray) -> FloatArray:
        """Shape (k, n), N·m, of poses (k, n), rad."""
        model, data, torques = self._model, self._data, []
        for pose, imu in zip(position, self._imu, strict=True):
            data.qpos[self._addresses.qpos] = pose
            if (
                self._frame is not None
            ):  # gravity turns about the robot, so that the model's IMU reads what was recorded
                mujoco.mj_kinematics(model, data)
                kind, i = self._frame
                matrices = data.site_xmat if kind == mujoco.mjtObj.mjOBJ_SITE else data.xmat
                model.opt.gravity[:] = matrices[i].reshape(3, 3) @ rotate(conjugate(imu), self._down)
            mujoco.mj_forward(model, data)
            torques.append((data.qfrc_bias - data.qfrc_passive)[self._addresses.dof])
        return np.array(torques)

    def misfit(self, mirrored: int | None) -> FloatArray:
        """Shape (n,): squares of what is beyond the tolerance, in tolerances, averaged, if one joint is mirrored."""
        position, effort = self.position.copy(), self.effort.copy()
        if mirrored is not None:
            position[:, mirrored] *= -1.0
            effort[:, mirrored] *= -1.0
        lower, upper, expected = self._description.lower, self._description.upper, self.torque(position)
        beyond = np.abs(effort - expected) / (_FRICTION + _SHARE * np.abs(expected)) - 1.0
        is_free = (position > lower + _AT_STOP) & (position < upper - _AT_STOP)
        is_impossible = (position < lower - _IMPOSSIBLE) | (position > upper + _IMPOSSIBLE)
        beyond = np.where(is_free, np.maximum(beyond, 0.0), np.where(is_impossible, np.inf, 0.0))
        misfit: FloatArray = np.square(beyond).mean(axis=0)
        return misfit
