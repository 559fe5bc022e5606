"""Stability of damping at a physics step.

The MIT law's damping is explicit: one Euler step multiplies the joint velocities by `I - dt · M⁻¹ · K_d`. Where an
eigenvalue of `dt · M⁻¹ · K_d` exceeds 1 the velocity changes sign every step, above 2 it grows until the torque
saturates: the joint chatters at its limit without ever going non-finite. `M` holds the motors' reflected inertia.

Implicit damping (`humanoid_sim.simulation.plant.ImplicitPlant`) has no such limit, only stiffness has: a step of the
undamped law turns a joint's oscillation by `dt · ω`, where `ω² = (M + ½ dt · K_d)⁻¹ · K_p`, and is unstable above 2.
But a motor at its effort limit is not damped at all. So where `dt · M⁻¹ · K_d` exceeds 2, a joint that was thrown to
that limit may stay there and chatter, as with explicit damping.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import joint_addresses

WARNED_ABOVE = 1.0
REFUSED_ABOVE = 2.0

_MEASURABLE = 1e100
"""1/s, of an entry of M⁻¹·K_d: far beyond any motor, and far below where the eigenvalues overflow."""
_SHORTEST_STEP = 1e-6
"""s: a physics step that is still worth proposing."""


@dataclass(frozen=True, slots=True)
class DampingMeasure:
    """The worst of the sampled poses."""

    eigenvalue: float
    """Largest eigenvalue of `dt · M⁻¹ · K_d`, dimensionless."""
    joint: str
    """The joint that moves most in that eigenvector."""


class DampingStability:
    """Inverse mass matrices of a robot over sampled poses, against which any damping is measured."""

    def __init__(
        self, model: mujoco.MjModel, description: RobotDescription, *, samples: int = 64, seed: int = 0
    ) -> None:
        """Sample poses: the description's own, and `samples` drawn uniformly within the joint limits."""
        n = description.joint_count
        self._description = description
        self._timestep = float(model.opt.timestep)
        self.is_implicit = bool(model.opt.integrator != mujoco.mjtIntegrator.mjINT_EULER)
        """True if damping is integrated implicitly: it is then stable however large, until a motor is at its limit."""
        poses: list[npt.ArrayLike] = [
            description.initial_position,
            *description.standby_controller_a.pose_segments,
            *description.standby_controller_b.pose_segments,
        ]
        lower, upper = description.lower, description.upper
        draw = np.random.default_rng(seed).uniform(
            np.where(np.isfinite(lower), lower, -np.pi),
            np.where(np.isfinite(upper), upper, np.pi),
            (samples, n),
        )
        poses.extend(draw)
        self._inverse_mass = np.empty((len(poses), n, n))
        """The joints' block of M⁻¹ for each pose; other joints of the model (a base) are free to move."""
        addresses = joint_addresses(model, description.joint_names)
        # What hangs together with the joints: the inverse of all else, such as a piano's keys, is a block of its own.
        trees = model.dof_treeid
        hanging = np.flatnonzero(np.isin(trees, trees[addresses.dof]))
        joints = np.searchsorted(hanging, addresses.dof)
        data = mujoco.MjData(model)
        mass = np.empty((model.nv, model.nv))
        for i, pose in enumerate(poses):
            data.qpos[addresses.qpos] = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)
            mujoco.mj_fullM(model, data, mass)
            try:
                inverse = np.linalg.inv(mass[np.ix_(hanging, hanging)])
            except np.linalg.LinAlgError:
                what = "a joint moves nothing that has mass or inertia"
                raise InputError(
                    f"{description.mjcf_path}: {what}; give its body a mass, or the joint an armature"
                ) from None
            self._inverse_mass[i] = inverse[np.ix_(joints, joints)]

    def measure(self, damping: npt.ArrayLike) -> DampingMeasure:
        """Measure a K_d: shape (n,) or scalar, N·m·s/rad. Infinite at the largest if it is beyond all measure."""
        symmetric = self._symmetric(damping)
        if not (np.abs(symmetric) < _MEASURABLE).all():  # NaN too
            return DampingMeasure(math.inf, self._description.joint_names[int(np.argmax(self._per_joint(damping)))])
        return self._worst(symmetric)

    def _worst(self, symmetric: npt.NDArray[np.float64]) -> DampingMeasure:
        """Return the largest eigenvalue of the poses' matrices, times the physics step."""
        values, vectors = np.linalg.eigh(symmetric)
        worst = int(np.argmax(values[:, -1]))
        joint = int(np.argmax(np.abs(vectors[worst, :, -1])))
        return DampingMeasure(self._timestep * float(values[worst, -1]), self._description.joint_names[joint])

    def exceeds(self, damping: npt.ArrayLike, limit: float) -> bool:
        """Return whether the eigenvalue under a K_d, as `measure` takes it, is above a limit.

        The entries bound it, and most often tell: the linear algebra of small matrices waits for threads of its own,
        which takes 50 times as long where the processors are busy.
        """
        symmetric = np.abs(self._symmetric(damping))
        if not (symmetric < _MEASURABLE).all():
            return True
        if self._timestep * np.einsum("pii->pi", symmetric).max(initial=0.0) > limit:
            return True
        doubtful = self._timestep * symmetric.sum(axis=2).max(axis=1, initial=0.0) > limit
        values = np.linalg.eigvalsh(self._symmetric(damping)[doubtful])
        return bool((self._timestep * values > limit).any())

    def _symmetric(self, damping: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return √K_d M⁻¹ √K_d of each pose, which is symmetric and has the eigenvalues of M⁻¹ K_d."""
        root = np.sqrt(self._per_joint(damping))
        with np.errstate(over="ignore", invalid="ignore"):
            symmetric: npt.NDArray[np.float64] = root[:, None] * self._inverse_mass * root
        return symmetric

    def measure_stiffness(self, stiffness: npt.ArrayLike, damping: npt.ArrayLike) -> DampingMeasure:
        """Measure `dt · ω` of the undamped oscillation under implicit damping; arguments (n,) or scalar."""
        root = np.sqrt(self._per_joint(stiffness))
        added = 0.5 * self._timestep * np.diag(self._per_joint(damping))
        damped = np.linalg.inv(np.linalg.inv(self._inverse_mass) + added)
        squared = self._worst(root[:, None] * damped * root)
        return replace(squared, eigenvalue=math.sqrt(self._timestep * max(squared.eigenvalue, 0.0)))

    def suits(self, damping: npt.ArrayLike, stiffness: npt.ArrayLike, limit: float) -> bool:
        """Return whether gains, as `check` takes them, stay below a limit of what is unstable above `REFUSED_ABOVE`."""
        if self.is_implicit:
            return self.measure_stiffness(stiffness, damping).eigenvalue <= limit
        return not self.exceeds(damping, limit)

    def check(self, damping: npt.ArrayLike, what: str, stiffness: npt.ArrayLike = 0.0) -> str:
        """Warn about a K_d and its K_p, or return '' if they are stable without oscillation; `what` has them.

        K_p matters only where damping is implicit. Raises `InputError` if it is unstable at this physics step; the
        message names the joint, and a step that works, if there is one.
        """
        if self.is_implicit:
            return self._check_implicit(damping, stiffness, what)
        if not self.exceeds(damping, WARNED_ABOVE):
            return ""
        measure = self.measure(damping)
        message = (
            f"{what}: dt·M⁻¹·K_d reaches {_shown(measure.eigenvalue)} at {measure.joint} with a physics step of "
            f"{self._timestep:g} s"
        )
        self._refuse_unstable(message, measure)
        return f"{message}: stable, but the velocity changes sign from step to step above {WARNED_ABOVE:g}"

    def _check_implicit(self, damping: npt.ArrayLike, stiffness: npt.ArrayLike, what: str) -> str:
        gains = np.concatenate([np.ravel(damping), np.ravel(stiffness)])
        if not (np.abs(gains) < _MEASURABLE).all():
            raise InputError(f"{what}: the gains are beyond all measure, and no physics step makes them stable")
        measure, step = self.measure_stiffness(stiffness, damping), f"implicit steps of {self._timestep:g} s"
        if measure.eigenvalue > WARNED_ABOVE:
            reached = f"dt·√((M + ½·dt·K_d)⁻¹·K_p) reaches {_shown(measure.eigenvalue)} at {measure.joint}"
            message = f"{what}: {reached} with {step}"
            self._refuse_unstable(message, measure)
            return f"{message}: stable, but its oscillations are far off above {WARNED_ABOVE:g}"
        if not self.exceeds(damping, REFUSED_ABOVE):
            return ""
        chatter = self.measure(damping)
        return (
            f"{what}: dt·M⁻¹·K_d reaches {_shown(chatter.eigenvalue)} at {chatter.joint} with {step}: stable, but a "
            f"joint that is thrown to its effort limit may chatter there above {REFUSED_ABOVE:g}"
        )

    def _refuse_unstable(self, message: str, measure: DampingMeasure) -> None:
        if measure.eigenvalue > REFUSED_ABOVE:
            longest = self._timestep * REFUSED_ABOVE / measure.eigenvalue
            remedy = (
                f"use less than {longest:.2g} s, such as {_round_step_below(longest):g} s"
                if longest > _SHORTEST_STEP
                else "and no physics step makes it stable"
            )
            raise InputError(f"{message}: unstable above {REFUSED_ABOVE:g}, {remedy}")

    def check_description(self) -> tuple[str, ...]:
        """Return the warnings about all the description's own gains. Raises as `check`."""
        robot = self._description
        a, b = robot.standby_controller_a, robot.standby_controller_b
        owners: dict[tuple[tuple[float, ...], tuple[float, ...]], list[str]] = {}
        for name, damping, stiffness in (
            ("joints", robot.damping, robot.stiffness),
            ("damping_controller", robot.mode_damping, 0.0),
            ("standby_controller_a", a.target_damping, a.target_stiffness),
            ("standby_controller_b", b.target_damping, b.target_stiffness),
            ("remote_policy_controller", robot.passive_damping, 0.0),
        ):
            gains = self._per_joint(damping), self._per_joint(stiffness if self.is_implicit else 0.0)
            owners.setdefault((tuple(gains[0].tolist()), tuple(gains[1].tolist())), []).append(name)
        found = [
            self.check(damping, f"{robot.name}: {', '.join(names)}", stiffness)
            for (damping, stiffness), names in owners.items()
        ]
        return tuple(warning for warning in found if warning)

    def _per_joint(self, gains: npt.ArrayLike) -> npt.NDArray[np.float64]:
        return np.broadcast_to(np.asarray(gains, dtype=np.float64), (self._description.joint_count,))


def _shown(value: float) -> str:
    return f"{value:.2f}" if value < 1e6 else f"{value:.2g}"


def _round_step_below(limit: float) -> float:
    """s: the longest step below `limit` out of 1, 2.5 and 5 times a power of ten, which divide the usual periods."""
    decade = 10.0 ** math.floor(math.log10(limit))
    return max(factor * decade for factor in (0.5, 1.0, 2.5, 5.0) if factor * decade < limit)
