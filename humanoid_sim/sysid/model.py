"""The robot as it is fitted: its parameters, and a rollout under the commands that its motors were given.

Every joint has three actuators, whose controls are -K_p, -K_d and K_p q_cmd + K_d qd_cmd + tau_ff: together the MIT law
for gains that change, in one native call. The joint's own force range saturates their sum. A command holds from its
time plus the joint's delay until the next; in the physics step in which it arrives it counts for its share of the step,
so that a prediction depends smoothly on the delay.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import mujoco
import numpy as np
from mujoco import rollout

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import FloatingBase, base_addresses
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.sysid.data import Window

KINDS = ("armature", "friction", "damping", "torque_scale", "offset", "delay")
"""Parameters of a joint, in this order everywhere."""
UNITS: Mapping[str, str] = {
    "armature": "kg·m²",
    "friction": "N·m",
    "damping": "N·m·s/rad",
    "torque_scale": "",
    "offset": "rad",
    "delay": "s",
}
LONGEST_DELAY = 0.06
"""s"""
_AT_ONCE = 12
"""Robots that are simulated in one call: memory is bounded by it."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """Predicted reports of a window, shape (ticks, n) each; see `Run`."""

    position: FloatArray
    velocity: FloatArray
    effort: FloatArray


class FitModel:
    """Some joints of a robot, the branches of the others left out where nothing couples them."""

    def __init__(self, description: RobotDescription, joints: Sequence[int], timestep: float | None = None) -> None:
        """Build the model. A floating base hangs in its support.

        Args:
            joints: indices of the joints that are fitted, whole branches.
            timestep: s; a longer one than the robot's own is integrated implicitly.
        """
        self.description = description
        self.joints = tuple(joints)
        own = description.simulation.physics_timestep
        self.timestep = own if timestep is None else timestep
        names = tuple(description.joint_names[i] for i in self.joints)
        kept = msgspec.structs.replace(
            description,
            joints=tuple(description.joints[i] for i in self.joints),
            initial_position=tuple(description.initial_position[i] for i in self.joints),
            hands=(),
            piano=None,
        )
        self.limit = np.array([joint.effort_limit for joint in kept.joints])
        self.model = build_model(
            kept,
            physics_timestep=self.timestep,
            implicit=self.timestep > own,
            scene=False,
            edit=lambda spec: self._edit(spec, names),
        )
        addresses = joint_addresses(self.model, names)
        self.qpos, self.dof = addresses.qpos, addresses.dof
        self._joint_ids = np.array([self.model.joint(name).id for name in names])
        for i, limit in zip(self._joint_ids, self.limit, strict=True):
            self.model.jnt_actfrclimited[i] = np.isfinite(limit)
            self.model.jnt_actfrcrange[i] = -limit, limit
        self._start = mujoco.MjData(self.model)
        self._start.qpos[self.qpos] = kept.initial_position
        if kept.is_floating:
            FloatingBase(self.model, kept, self._start.qpos).place(self._start)
            position, quaternion, *_ = base_addresses(self.model, kept)
            support = int(self.model.body_mocapid.argmax())
            self.model.body_pos[support] = self._start.qpos[position]
            self.model.body_quat[support] = self._start.qpos[quaternion]
            self.model.eq_active0[self.model.eq_obj1id == support] = 1
        self._state_size = mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._datas = [mujoco.MjData(self.model) for _ in range(min(os.cpu_count() or 1, 4))]

    def nominal(self) -> FloatArray:
        """Shape (6, n): the parameters that the description has, in the order of `KINDS`."""
        model, n = self.model, len(self.joints)
        known = [model.dof_armature[self.dof], model.dof_frictionloss[self.dof], model.dof_damping[self.dof]]
        motors = [self.description.torque_scale[[*self.joints]], np.zeros(n), self.description.delay[[*self.joints]]]
        return np.array([*known, *motors])

    def with_parameters(self, values: FloatArray) -> mujoco.MjModel:
        """Return a model with parameters of shape (6, n); offset and delay are not in it, but in `rollout`."""
        model = copy.copy(self.model)
        model.dof_armature[self.dof], model.dof_frictionloss[self.dof], model.dof_damping[self.dof] = values[:3]
        data = mujoco.MjData(model)
        mujoco.mj_setConst(model, data)
        scale = np.repeat(values[3], 3)
        model.actuator_gainprm[:, :3] *= scale[:, None]
        limits = np.where(np.isfinite(self.limit), values[3] * self.limit, 0.0)
        model.jnt_actfrcrange[self._joint_ids] = np.stack([-limits, limits], axis=1)
        return model

    def control(self, window: Window) -> FloatArray:
        """Shape (ticks, 3 n): what the actuators are given, of all ticks from the longest delay before the window."""
        command = window.run.command[_before(window) : window.last][:, :, self.joints]
        position, velocity, effort, stiffness, damping = np.moveaxis(command, 1, 0)
        target = stiffness * position + damping * velocity + effort
        return np.stack([-stiffness, -damping, target], axis=2).reshape(len(command), -1)

    def start_state(self, window: Window) -> FloatArray:
        """Return MuJoCo's full state at the beginning of a window, as it was measured."""
        return self._initial(np.zeros((len(KINDS), len(self.joints))), window)

    def rollout(
        self, models: Sequence[mujoco.MjModel], values: Sequence[FloatArray], window: Window
    ) -> list[Prediction]:
        """Predict what the joints report in a window, once for each model with its parameters, (6, n) each."""
        found: list[Prediction] = []
        for i in range(0, len(models), _AT_ONCE):
            found += self._rollout(models[i : i + _AT_ONCE], values[i : i + _AT_ONCE], window)
        return found

    def _rollout(
        self, models: Sequence[mujoco.MjModel], values: Sequence[FloatArray], window: Window
    ) -> list[Prediction]:
        run, first, last = window.run, window.first, window.last
        begin = run.time[first] - run.age[first, self.joints].min()
        reported = run.time[first:last, None] - run.age[first:last, self.joints] - begin
        steps = int(np.ceil((reported.max() + 1e-9) / self.timestep)) + 1
        told = run.time[_before(window) : last] - begin
        commands = self.control(window)
        controls = np.stack([self._controls(commands, told, parameters, steps) for parameters in values])
        starts = np.stack([self._initial(parameters, window) for parameters in values])
        states, _ = rollout.rollout(list(models), self._datas, starts, controls)
        nq = self.model.nq
        predictions = []
        for parameters, start, state, control in zip(values, starts, states, controls, strict=True):
            whole = np.concatenate([start[None], state])
            position = whole[:, 1 + self.qpos] + parameters[4]
            velocity = whole[:, 1 + nq + self.dof]
            place = np.clip(reported / self.timestep, 0.0, steps)
            index = np.minimum(place.astype(np.intp), steps - 1)
            share = place - index
            columns = np.arange(len(self.joints))

            def at(signal: FloatArray, index: Any = index, share: Any = share, columns: Any = columns) -> FloatArray:
                value: FloatArray = (1.0 - share) * signal[index, columns] + share * signal[index + 1, columns]
                return value

            q, v = at(position), at(velocity)
            gains = control.reshape(steps, -1, 3)[index, columns]
            # the control already has the offset in it, for a law on the true angle
            law = gains[..., 0] * (q - parameters[4]) + gains[..., 1] * v + gains[..., 2]
            predictions.append(Prediction(q, v, np.clip(law, -self.limit, self.limit)))
        return predictions

    def _controls(self, commands: FloatArray, told: FloatArray, parameters: FloatArray, steps: int) -> FloatArray:
        """Shape (steps, 3 n): the mean over each physics step of the command in force, as an angle without offset."""
        n = len(self.joints)
        given = commands.reshape(len(commands), n, 3).copy()
        given[..., 2] += given[..., 0] * parameters[4]
        result = np.empty((steps, n, 3))
        edges = self.timestep * np.arange(steps + 1)
        for j in range(n):
            arrival = told + parameters[5, j]
            # the integral of a staircase is piecewise linear: its differences are the means over the steps
            spans = np.diff(arrival, append=max(arrival[-1], edges[-1]) + 1.0)
            total = np.concatenate([np.zeros((1, 3)), np.cumsum(given[:, j] * spans[:, None], axis=0)])
            knots = np.append(arrival, arrival[-1] + spans[-1])
            for k in range(3):
                area = np.interp(edges, knots, total[:, k])
                early = edges < arrival[0]  # nothing older is known: the first command holds
                area = np.where(early, (edges - arrival[0]) * given[0, j, k], area)
                result[:, j, k] = np.diff(area) / self.timestep
        return result.reshape(steps, -1)

    def _initial(self, parameters: FloatArray, window: Window) -> FloatArray:
        run, first = window.run, window.first
        data = self._start
        data.qpos[self.qpos] = run.position[first, self.joints] - parameters[4]
        data.qvel[:] = 0.0
        data.qvel[self.dof] = run.velocity[first, self.joints]
        data.time = 0.0
        state = np.empty(self._state_size)
        mujoco.mj_getState(self.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state

    def _edit(self, spec: mujoco.MjSpec, names: Sequence[str]) -> None:
        self.spec = spec
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        for sensor in tuple(spec.sensors):
            spec.delete(sensor)
        others = [name for name in self.description.joint_names if name not in names]
        for body in {spec.joint(name).parent.name for name in others}:
            found = spec.body(body)
            if found is not None:  # else it went with another one that carries it
                spec.delete(found)
        for name in names:
            for place in range(3):
                gain = [0.0] * 10
                gain[(1, 2, 0)[place]] = 1.0
                spec.add_actuator(
                    name=f"{name}/{place}",
                    target=name,
                    trntype=mujoco.mjtTrn.mjTRN_JOINT,
                    gaintype=mujoco.mjtGain.mjGAIN_AFFINE,
                    gainprm=gain,
                    biastype=mujoco.mjtBias.mjBIAS_NONE,
                )
        for kind in (
            mujoco.mjtSensor.mjSENS_JOINTPOS,
            mujoco.mjtSensor.mjSENS_JOINTVEL,
            mujoco.mjtSensor.mjSENS_JOINTACTFRC,
        ):
            for name in names:  # what `mujoco.sysid` expects of measured data; nothing computes them
                spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name)


def _before(window: Window) -> int:
    """Return the first tick whose command may still act when the window begins."""
    time = window.run.time
    latest = time[window.first] - np.nanmax(window.run.age[window.first]) - LONGEST_DELAY
    return max(int(np.searchsorted(time, latest)) - 1, 0)


def islands(description: RobotDescription) -> list[tuple[int, ...]]:
    """Return the joints in groups that do not act on one another: branches of a base that is fixed to the world."""
    if description.is_floating:
        return [tuple(range(description.joint_count))]
    model = build_model(description, scene=False)
    groups: dict[int, list[int]] = {}
    for i, name in enumerate(description.joint_names):
        body = int(model.jnt_bodyid[model.joint(name).id])
        top = body
        while body:
            top = body if model.body_dofnum[body] else top
            body = int(model.body_parentid[body])
        groups.setdefault(top, []).append(i)
    return [tuple(group) for group in groups.values()]
