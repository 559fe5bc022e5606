"""Stability of a robot's gains at a physics step.

The MIT law's damping is explicit: one Euler step multiplies the joint velocities by `I - dt · M⁻¹ · K_d`. Where an
eigenvalue of `dt · M⁻¹ · K_d` exceeds 1 the velocity changes sign every step, above 2 it grows until the torque
saturates: the joint chatters at its limit without ever going non-finite. `M` holds the motors' reflected inertia.

Implicit damping has no such limit, only stiffness has: a step turns an oscillation by `dt · ω`, where
`ω² = (M + ½ dt · K_d)⁻¹ · K_p`, and is unstable above 2.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import joint_addresses

_WARNED_ABOVE, _REFUSED_ABOVE = 1.0, 2.0
_SAMPLES = 64  # random poses, within the joint limits
_MEASURABLE = 1e100  # 1/s, of an entry of M⁻¹·K: beyond any motor, and far below where eigenvalues overflow


class DampingStability:
    """Inverse mass matrices of a robot over sampled poses, against which any gains are measured."""

    def __init__(self, model: mujoco.MjModel, description: RobotDescription) -> None:
        """Sample the description's own poses and random ones. Raises `InputError` where nothing has inertia."""
        self._description = description
        self._timestep = float(model.opt.timestep)
        self._is_implicit = model.opt.integrator != mujoco.mjtIntegrator.mjINT_EULER
        n, lower, upper = description.joint_count, description.lower, description.upper
        low, high = np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)
        poses: list[npt.ArrayLike] = [
            description.initial_position,
            *description.standby_controller_a.pose_segments,
            *description.standby_controller_b.pose_segments,
            *np.random.default_rng(0).uniform(low, high, (_SAMPLES, n)),
        ]
        self._inverse_mass = np.empty((len(poses), n, n))
        """The joints' block of M⁻¹ for each pose; other joints of the model (a base) are free to move."""
        addresses = joint_addresses(model, description.joint_names)
        # What is connected with the joints: the inverse of the rest, such as a piano's keys, is a block of its own.
        connected = np.flatnonzero(np.isin(model.dof_treeid, model.dof_treeid[addresses.dof]))
        joints = np.searchsorted(connected, addresses.dof)
        data, mass = mujoco.MjData(model), np.empty((model.nv, model.nv))
        for i, pose in enumerate(poses):
            data.qpos[addresses.qpos] = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)
            mujoco.mj_fullM(model, data, mass)
            try:
                inverse = np.linalg.inv(mass[np.ix_(connected, connected)])
            except np.linalg.LinAlgError:
                reason = "a joint moves nothing that has mass or inertia; give its body a mass, or it an armature"
                raise InputError(f"{description.mjcf_path}: {reason}") from None
            self._inverse_mass[i] = inverse[np.ix_(joints, joints)]

    def measure(self, damping: npt.ArrayLike, stiffness: npt.ArrayLike = 0.0) -> tuple[float, str]:
        """Return the largest eigenvalue of `dt · M⁻¹ · K_d` over the poses, and the joint that moves most in it.

        K_d, N·m·s/rad, and K_p, N·m/rad, are (n,) or scalar. Where damping is implicit it is the largest `dt · ω`.
        """
        names, inverse = self._description.joint_names, self._inverse_mass
        k_d, k_p = (np.broadcast_to(np.asarray(gain, np.float64), (len(names),)) for gain in (damping, stiffness))
        gain = k_p if self._is_implicit else k_d
        if self._is_implicit:
            inverse = np.linalg.inv(np.linalg.inv(inverse) + 0.5 * self._timestep * np.diag(k_d)).astype(np.float64)
        with np.errstate(over="ignore", invalid="ignore"):
            symmetric = np.sqrt(gain)[:, None] * inverse * np.sqrt(gain)  # of the eigenvalues of M⁻¹·K
        if not (np.abs(symmetric) < _MEASURABLE).all():  # NaN too
            return math.inf, names[int(np.argmax(gain))]
        values, vectors = np.linalg.eigh(symmetric)
        worst = int(np.argmax(values[:, -1]))
        largest = self._timestep * max(float(values[worst, -1]), 0.0)
        value = math.sqrt(self._timestep * largest) if self._is_implicit else largest
        return value, names[int(np.argmax(np.abs(vectors[worst, :, -1])))]

    def check(self, damping: npt.ArrayLike, what: str, stiffness: npt.ArrayLike = 0.0) -> str:
        """Return a warning about gains as `measure` takes them, or '' if they are stable; `what` has them.

        Raises `InputError` if they are unstable.
        """
        value, joint = self.measure(damping, stiffness)
        if value <= _WARNED_ABOVE:
            return ""
        formula = "dt·√((M + ½·dt·K_d)⁻¹·K_p)" if self._is_implicit else "dt·M⁻¹·K_d"
        message = f"{what}: {formula} reaches {value:.3g} at {joint} with a physics step of {self._timestep:g} s"
        if value <= _REFUSED_ABOVE:
            return f"{message}: stable, but the velocity changes sign from step to step above {_WARNED_ABOVE:g}"
        longest = self._timestep * _REFUSED_ABOVE / value
        raise InputError(f"{message}: unstable above {_REFUSED_ABOVE:g}; use a step of less than {longest:.2g} s")

    def check_description(self) -> tuple[str, ...]:
        """Return the warnings about the description's own gains. Raises as `check`."""
        robot = self._description
        a, b = robot.standby_controller_a, robot.standby_controller_b
        gains: list[tuple[str, npt.ArrayLike, npt.ArrayLike]] = [
            ("joints", robot.damping, robot.stiffness),
            ("damping_controller", robot.mode_damping, 0.0),
            ("standby_controller_a", a.target_damping, a.target_stiffness),
            ("standby_controller_b", b.target_damping, b.target_stiffness),
        ]
        if not np.array_equal(robot.passive_damping, robot.mode_damping):
            gains.append(("remote_policy_controller", robot.passive_damping, 0.0))
        found = [self.check(k_d, f"{robot.name}: {owner}", k_p) for owner, k_d, k_p in gains]
        return tuple(warning for warning in found if warning)
