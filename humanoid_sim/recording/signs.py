"""Directions and zeros of joints, judged in a recording: efforts at rest against the torque that gravity needs."""

from __future__ import annotations

from dataclasses import dataclass, replace

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

_LEAST = 1.0
"""s that a rest lasts at least; the efforts of its second half count."""
_MOVED, _COMMANDED = 0.02, 1e-3
"""rad by which positions and commands differ at most in a rest."""
_FRICTION, _SHARE = 0.3, 0.15
"""N·m, and share of the expected torque, by which a sound joint's effort differs from its model's."""
_AT_STOP, _IMPOSSIBLE = 0.03, 0.1
"""rad before a position limit, where the stop may carry the joint, and beyond it, where no joint is."""
_OFFSETS = (-0.8, -0.6, -0.4, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8)
"""rad by which a zero may be wrong."""
_VISIBLE = 1.0
"""Misfit, in tolerances squared, by which a mirrored joint would show."""
_EXPLAINED, _PREFERENCE = 0.1, 0.05
"""Shares of a limb's misfit: that an explanation may leave, and by which a zero must explain more than a direction."""


@dataclass(frozen=True, slots=True)
class JointSign:
    """Verdict on one joint, with its efforts, N·m, in the rest in which they differ most."""

    joint: str
    measured: float
    expected: float
    verdict: str


@dataclass(frozen=True, slots=True, eq=False)
class _Rests:
    """A robot's k rests while it was held."""

    position: FloatArray
    """Shape (k, n), rad."""
    effort: FloatArray
    """Shape (k, n), N·m."""
    imu: FloatArray
    """Shape (k, 4), w x y z."""

    def with_fault(self, joint: int, offset: float | None) -> _Rests:
        """Return where the robot really was, with a zero that is wrong by an offset, or (None) mirrored."""
        position, effort = self.position.copy(), self.effort.copy()
        if offset is None:
            position[:, joint] *= -1.0
            effort[:, joint] *= -1.0
        else:
            position[:, joint] += offset
        return replace(self, position=position, effort=effort)


def judge_signs(recording: Recording, description: RobotDescription) -> tuple[JointSign, ...]:
    """Judge every joint of a recorded robot, in its order.

    In each limb the one wrong direction or zero that explains what contradicts gravity is named. Raises `InputError` if
    the robot never rested while it was held.
    """
    rests, gravity = _rests(recording, description), _Gravity(description)
    expected, sound = gravity.torque(rests), gravity.misfit(rests)
    verdicts = [""] * description.joint_count
    for limb in gravity.limbs:
        misfit = float(sound[limb].sum())
        left = {
            (joint, offset): float(gravity.misfit(rests.with_fault(joint, offset))[limb].sum())
            for joint in limb
            for offset in (None, *_OFFSETS)
        }
        joint, offset = min(left, key=lambda fault: left[fault] + (fault[1] is not None) * _PREFERENCE * misfit)
        is_explained = left[joint, offset] <= _EXPLAINED * misfit
        for i in limb:
            if misfit == 0.0:
                verdicts[i] = "agrees" if left[i, None] > _VISIBLE else "too small to say"
            elif is_explained and i == joint:
                what = "direction wrong?" if offset is None else f"zero off by about {-offset:.1f} rad?"
                verdicts[i] = f"contradicts: {what}"
            elif sound[i] > 0.0:
                cause = f"explained by {description.joint_names[joint]}" if is_explained else "load or contact?"
                verdicts[i] = f"contradicts: {cause}"
            else:
                verdicts[i] = "too small to say"
    worst = np.abs(rests.effort - expected).argmax(axis=0)
    return tuple(
        JointSign(name, float(rests.effort[worst[i], i]), float(expected[worst[i], i]), verdicts[i])
        for i, name in enumerate(description.joint_names)
    )


def _rests(recording: Recording, description: RobotDescription) -> _Rests:
    # On its feet, as a floating base is in the other modes, a robot's legs carry what no model tells apart.
    held = (Mode.STANDBY,) if description.is_floating else (Mode.STANDBY, Mode.LOCOMOTION, Mode.REMOTE)
    rests: list[list[TickRecord]] = [[]]
    for tick in recording.ticks():
        state = tick.input.state
        if tick.output.control_mode.mode not in held or not np.isfinite(state.joint_effort).all():
            rests.append([])
            continue
        if rests[-1]:
            first = rests[-1][0]
            moved = np.abs(state.joint_position - first.input.state.joint_position)
            commanded = np.abs(tick.output.command.position - first.output.command.position)
            if not ((moved <= _MOVED).all() and (commanded <= _COMMANDED).all()):
                rests.append([])
        rests[-1].append(tick)
    least = _LEAST / recording.header.control_period
    states = [[tick.input.state for tick in rest[len(rest) // 2 :]] for rest in rests if len(rest) >= least]
    if not states:
        modes = " or ".join(mode.name for mode in held)
        raise InputError(f"{recording.path}: the robot never rested for {_LEAST:g} s in {modes}")
    return _Rests(
        np.array([np.mean([state.joint_position for state in rest], axis=0) for rest in states]),
        np.array([np.mean([state.joint_effort for state in rest], axis=0) for rest in states]),
        np.array([rest[-1].imu_quaternion for rest in states]),
    )


class _Gravity:
    """Torque that holds a robot's joints in any pose, as its model has it."""

    def __init__(self, description: RobotDescription) -> None:
        self._model = model = build_model(description, scene=False)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self._data = mujoco.MjData(model)
        self._addresses = joint_addresses(model, description.joint_names)
        self._base = base_addresses(model, description)[1] if description.is_floating else None
        self._imu = named_frame(model, description.imu, "imu")
        self._lower, self._upper = description.lower, description.upper
        bodies = [int(model.joint(name).bodyid[0]) for name in description.joint_names]
        roots = [next(b for b in reversed(bodies_above(model, body)) if b in bodies) for body in bodies]
        self.limbs = [[i for i, other in enumerate(roots) if other == root] for root in dict.fromkeys(roots)]
        """Indices of the joints that hang on the base together."""

    def torque(self, rests: _Rests) -> FloatArray:
        """Shape (k, n), N·m."""
        return np.array([self._hold(*pose) for pose in zip(rests.position, rests.imu, strict=True)])

    def _hold(self, position: FloatArray, imu: FloatArray) -> FloatArray:
        model, data = self._model, self._data
        data.qpos[self._addresses.qpos] = position
        if self._base is not None:  # turned so that the model's IMU reads what was recorded
            data.qpos[self._base] = 1.0, 0.0, 0.0, 0.0
            mujoco.mj_kinematics(model, data)
            kind, i = self._imu
            matrices = data.site_xmat if kind == mujoco.mjtObj.mjOBJ_SITE else data.xmat
            data.qpos[self._base] = multiply(imu, conjugate(quaternion_from_matrix(matrices[i].reshape(3, 3))))
        mujoco.mj_forward(model, data)
        torque: FloatArray = (data.qfrc_bias - data.qfrc_passive)[self._addresses.dof]
        return torque

    def misfit(self, rests: _Rests) -> FloatArray:
        """Shape (n,): squares of what is beyond the tolerance, in tolerances, averaged over the rests."""
        expected, place = self.torque(rests), rests.position
        off = np.abs(rests.effort - expected) / (_FRICTION + _SHARE * np.abs(expected)) - 1.0
        is_free = (place > self._lower + _AT_STOP) & (place < self._upper - _AT_STOP)
        is_impossible = (place < self._lower - _IMPOSSIBLE) | (place > self._upper + _IMPOSSIBLE)
        beyond = np.where(is_free, np.maximum(off, 0.0), np.where(is_impossible, np.inf, 0.0))
        misfit: FloatArray = np.square(beyond).mean(axis=0)
        return misfit
