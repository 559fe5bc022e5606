"""Load of gravity on each joint of a robot that is held, from its readings: the live input `GRAVITY_LEVERS`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import multiply
from humanoid_sim.errors import InputError
from humanoid_sim.mit import GRAVITY_LEVERS, Extern, FloatArray, MITState
from humanoid_sim.robots.schema import RobotDescription, SignSettings
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.model import bodies_above, build_model, joint_addresses
from humanoid_sim.simulation.sensors import Imu

_ANGLE = 0.03
"""rad, of the IMU's mounting, the encoders' zeros and the sag of links together."""
_BEYOND = 0.03
"""m that a payload may be beyond the centre of mass of the body that carries it."""
_PERIOD, _ROUNDING = 0.1, 1e-6
"""s between two samples; what binary numbers may make of a multiple of it."""
_FEET = 0.15
"""m above the lowest end of a limb up to which another one may stand on the ground too."""


class GravityLevers:
    """Computes them. Keeps its own `MjData`; not thread-safe."""

    def __init__(self, description: RobotDescription, settings: SignSettings) -> None:
        """Find the joints; `settings` say by how much a sound robot may differ from its model.

        Raises `InputError` if the MJCF does not fit the description, or couples joints by equality constraints.
        """
        model = build_model(description, scene=False)
        if model.neq > description.is_floating:  # the support's own
            raise InputError(f"{description.mjcf_path.name} couples joints by equality constraints")
        self._model, self._data, self._settings = model, mujoco.MjData(model), settings
        self._addresses = joint_addresses(model, description.joint_names)
        self._base = base_addresses(model, description)[1] if description.is_floating else None
        self._imu = Imu(model, description.imu)
        ids = np.array([model.joint(name).id for name in description.joint_names])
        self._ids = ids
        chains = [bodies_above(model, body) for body in range(model.nbody)]
        self._below = np.array([[int(model.jnt_bodyid[i]) in chain for chain in chains] for i in ids])
        order = [(len(chains[model.jnt_bodyid[i]]), int(i)) for i in ids]
        self._parents = [self._parent(k, order) for k in range(len(ids))]
        self._leaves = [k for k in range(len(ids)) if k not in self._parents]
        weight = model.body_mass * (1.0 - model.body_gravcomp)
        self._weight = np.linalg.norm(model.opt.gravity) * weight
        hinge = model.jnt_type[ids] == mujoco.mjtJoint.mjJNT_HINGE
        self._plain = hinge & (model.jnt_stiffness[ids] == 0.0)
        self._friction = np.maximum(settings.friction, model.dof_frictionloss[self._addresses.dof])

    def _parent(self, k: int, order: list[tuple[int, int]]) -> int:
        """Return the described joint next towards the base, -1 for none."""
        chain = bodies_above(self._model, int(self._model.jnt_bodyid[self._ids[k]]))
        above = [
            (place, j)
            for j, place in enumerate(order)
            if place < order[k] and int(self._model.jnt_bodyid[self._ids[j]]) in chain
        ]
        return max(above)[1] if above else -1

    def _upward(self, k: int) -> list[int]:
        chain = []
        while k >= 0:
            chain.append(k)
            k = self._parents[k]
        return chain

    def __call__(self, state: MITState) -> FloatArray:
        """Shape (n, `LEVER_COLUMNS`), at the state's joint positions and the IMU's tilt."""
        model, data = self._model, self._data
        data.qpos[self._addresses.qpos] = state.joint_position
        if self._base is not None:
            data.qpos[self._base] = 1.0, 0.0, 0.0, 0.0
            relative = self._imu.read(data).quaternion
            data.qpos[self._base] = multiply(state.imu_quaternion, relative * (1.0, -1.0, -1.0, -1.0))
        mujoco.mj_kinematics(model, data)
        axis = np.where(self._plain[:, None], data.xaxis[self._ids], 0.0)
        arms = data.xipos - data.xanchor[self._ids, None]
        moments = self._below[..., None] * self._weight[:, None] * arms
        levers = _about(axis[:, None], arms) * self._below
        moment = moments.sum(axis=1)
        settings = self._settings
        masses = settings.mass_error * np.abs(_about(axis[:, None], moments)).sum(axis=1)
        angles = _ANGLE * np.linalg.norm(np.cross(axis, moment), axis=-1)
        tolerance = self._friction + np.hypot(masses, angles)  # which have nothing to do with each other
        beyond = _BEYOND * np.hypot(axis[:, 0], axis[:, 1])
        # A payload is somewhere below the joint, and only adds.
        less, more = (
            tolerance + settings.payload * 9.81 * np.maximum((side * levers).max(axis=1) + beyond, 0.0)
            for side in (-1.0, 1.0)
        )
        return np.column_stack([axis, moment, self._parents, less, more, self._standing()])

    def _standing(self) -> FloatArray:
        """Shape (n,): 1 for the joints of limbs that end about as low as the lowest one, of a robot that stands."""
        ground = np.zeros(len(self._parents))
        if self._base is not None:
            heights = {leaf: self._data.xipos[self._model.jnt_bodyid[self._ids[leaf]], 2] for leaf in self._leaves}
            lowest = min(heights.values()) + _FEET
            for leaf in (leaf for leaf, height in heights.items() if height <= lowest):
                ground[self._upward(leaf)] = 1.0
        return ground


class LeverSamples:
    """The levers as a live input of a session, ten times a second while STANDBY holds the robot."""

    def __init__(self, levers: GravityLevers, control_period: float, held: Callable[[], MITState | None]) -> None:
        """Prepare; `held` gives the state of this tick, None while the robot is not in STANDBY; the period is in s."""
        self._levers, self._period, self._held = levers, control_period, held

    def latest(self) -> Mapping[str, Extern]:
        """Nothing in most ticks."""
        state = self._held()
        if state is None:
            return {}
        time = float(state.time)
        is_due = int(time / _PERIOD + _ROUNDING) != int((time - self._period) / _PERIOD + _ROUNDING)
        if not is_due or not np.isfinite(state.joint_position).all():
            return {}
        return {GRAVITY_LEVERS: Extern(self._levers(state), time)}


def _about(axis: FloatArray, moment: FloatArray) -> FloatArray:
    """Return the vertical force's torque about axes, shape (...)."""
    torque: FloatArray = axis[..., 0] * moment[..., 1] - axis[..., 1] * moment[..., 0]
    return torque
