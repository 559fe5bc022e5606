"""The models of a batch, as different as a randomisation says, its states, and how `mujoco.rollout` advances them."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from mujoco import rollout

from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.mit import BoolArray, FloatArray, IndexArray
from humanoid_sim.simulation.batch.draws import Draws

_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)
_CONTROL_AND_WRENCH = _CONTROL | int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)


def usable_processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):  # Linux
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class ModelPool:
    """N models of the same robot: one for all as long as they agree, else one each, copied once.

    The gains of its affine actuators live in them.
    """

    def __init__(self, nominal: mujoco.MjModel, count: int) -> None:
        """Share one copy of the model between `count` environments."""
        self.nominal = nominal
        self.is_shared = True
        shared = copy.copy(nominal)
        # An array of references picks any subset without a Python loop.
        self._models = np.empty(count, dtype=object)
        self._models[:] = shared
        self._list: list[mujoco.MjModel] = [shared] * count

    @cached_property
    def room(self) -> mujoco.MjData:
        """To work in, of any of the models."""
        return mujoco.MjData(self.nominal)

    def __getitem__(self, i: int) -> mujoco.MjModel:
        """Return the model of environment i."""
        return self._models[i]

    def select(self, indices: IndexArray | None) -> list[mujoco.MjModel]:
        """Return the models of these environments, None for all."""
        return self._list if indices is None else self._models[indices].tolist()

    def separate(self) -> None:
        """Give each environment a model of its own, equal to the shared one."""
        if self.is_shared:
            self.is_shared = False
            self._list = [copy.copy(self._list[0]) for _ in self._list]
            self._models[:] = self._list

    def set_gains(self, changed: IndexArray, bias: FloatArray) -> None:
        """Put gains into the actuators.

        Args:
            changed: shape (k,), environments whose gains are not yet in their models.
            bias: shape (N, n, 2), of all environments, see `affine_law`.
        """
        if self.is_shared:
            if (bias == bias[0]).all():
                changed = np.zeros(1, dtype=np.intp)
            else:
                self.separate()
                changed = np.arange(len(bias))
        for i in changed:
            self._models[i].actuator_biasprm[:, 1:3] = bias[i]


_INERTIAL = "mass", "centre_of_mass", "payload", "armature"
"""Fields after which MuJoCo must derive anew what the solver takes from masses."""
_OF_THE_MODEL = (*_INERTIAL, "friction", "joint_friction", "effort_limit", "motor_strength", "gravity_tilt")


def vary_models(pool: ModelPool, indices: IndexArray, draws: Draws, dof: IndexArray, carriers: IndexArray) -> None:
    """Make models those of their environments' episodes, in place, if any differ; nothing is compiled anew.

    Args:
        indices: shape (k,), the environments, whose models may have been varied before.
        dof: shape (n,), the joints' indices into `qvel`; the actuators are in their order.
        carriers: shape (c,), ids of the bodies that carry payload.
    """
    has, nominal = draws.randomisation.has, pool.nominal
    if not len(indices) or not has(*_OF_THE_MODEL):
        return
    pool.separate()
    models = pool.select(indices)
    if has("friction"):
        for model, factor in zip(models, draws.ranged("friction", indices)[:, 0], strict=True):
            model.geom_friction[:] = nominal.geom_friction * factor
            model.pair_friction[:] = nominal.pair_friction * factor
    if has("joint_friction"):
        for model, loss in zip(models, draws.ranged("joint_friction", indices), strict=True):
            model.dof_frictionloss[dof] = nominal.dof_frictionloss[dof] * loss
    if has("effort_limit", "motor_strength"):
        strength = draws.ranged("motor_strength", indices) * draws.ranged("effort_limit", indices)
        for model, factor in zip(models, strength, strict=True):
            model.actuator_forcerange[:] = nominal.actuator_forcerange * factor[:, None]
    if has("gravity_tilt"):
        gravity = rotate(gravity_turns(draws, indices), np.array(nominal.opt.gravity))
        for model, direction in zip(models, gravity, strict=True):
            model.opt.gravity[:] = direction
    if has(*_INERTIAL):
        _vary_inertia(pool, indices, draws, dof, carriers)


def _vary_inertia(pool: ModelPool, indices: IndexArray, draws: Draws, dof: IndexArray, carriers: IndexArray) -> None:
    nominal, models = pool.nominal, pool.select(indices)
    masses = draws.ranged("mass", indices)
    loads = draws.ranged("payload", indices)
    armatures = draws.ranged("armature", indices)
    shifts = draws.symmetric("centre_of_mass", indices).reshape(-1, nominal.nbody, 3)
    # Loose bodies keep theirs: MuJoCo's compiler has laid the mass matrix out for a centre of mass at their origin.
    is_robot = nominal.body_rootid == nominal.body_rootid[nominal.dof_bodyid[dof[0]]]
    movable = is_robot & (nominal.body_weldid != 0) & (nominal.body_simple == 0) & (nominal.body_mass > 0.0)
    shifts = np.where(movable[:, None], shifts, 0.0)
    is_shifted = draws.randomisation.has("centre_of_mass")
    for model, mass, load, armature, shift in zip(models, masses, loads, armatures, shifts, strict=True):
        model.body_mass[:] = nominal.body_mass * mass
        model.body_inertia[:] = nominal.body_inertia * mass[:, None]
        model.body_mass[carriers] += load
        model.dof_armature[dof] = nominal.dof_armature[dof] * armature
        if is_shifted:
            model.body_ipos[:] = nominal.body_ipos + shift
            model.body_sameframe[movable] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
        mujoco.mj_setConst(model, pool.room)  # what the solver derives from masses at the zero pose


def gravity_turns(draws: Draws, indices: IndexArray) -> FloatArray:
    """Rotations, shape (k, 4), w x y z, world frame, from the vertical to gravity's direction in these environments."""
    angle, direction = draws.turned("gravity_tilt", indices)
    turn = np.sin(0.5 * angle)
    return np.stack(
        [np.cos(0.5 * angle), turn * np.cos(direction), turn * np.sin(direction), np.zeros(len(turn))], axis=-1
    )


@dataclass(frozen=True, slots=True, eq=False)
class PhysicalStates:
    """States of N robots, each at one instant."""

    full: FloatArray
    """Shape (N, …), as MuJoCo orders them."""
    time: FloatArray
    """Shape (N,), s since each environment's start."""
    qpos: FloatArray
    """Shape (N, nq), MuJoCo's generalised position."""
    qvel: FloatArray
    """Shape (N, nv), MuJoCo's generalised velocity."""
    acceleration: FloatArray
    """Shape (N, nv), of the physics step before."""


class BatchPhysics:
    """N states that are advanced together, `steps` physics steps at a time, each as one simulation alone would be.

    The solver starts each step from the acceleration of the one before. MuJoCo's rollout does not return it, but under
    the Euler integrator it is the change of velocity over the timestep. (Passive joint damping, which MuJoCo integrates
    implicitly, makes that an approximation: the solver still comes to the same result, and an IMU on a moving body
    feels the acceleration after the damping.)
    """

    def __init__(
        self, pool: ModelPool, count: int, steps: int, threads: int, push_body: int, longest_delay: int = 0
    ) -> None:
        """Allocate.

        Args:
            steps: physics steps at a time.
            push_body: id of the body that wrenches act on.
            longest_delay: physics steps by which `past` looks back at most.
        """
        model = pool.nominal
        self._pool = pool
        self.model = model
        """The robots' as it is described."""
        self.threads = threads
        self._steps = steps
        self._push_body = push_body
        self._pushed: FloatArray | None = None
        self._timestep = float(model.opt.timestep)
        self._qpos = slice(1, 1 + model.nq)
        self._qvel = slice(1 + model.nq, 1 + model.nq + model.nv)
        width = mujoco.mj_stateSize(model, _STATE)
        self._state = np.zeros((count, width))
        self._before = np.zeros((count, width))
        self._path = np.zeros((count, steps, width))
        self.time = self._state[:, 0]
        """Shape (N,), s since each environment's start; as the next, a view that changes with the states."""
        self.qpos = self._state[:, self._qpos]
        """Shape (N, nq), MuJoCo's generalised position."""
        self.qvel = self._state[:, self._qvel]
        """Shape (N, nv), MuJoCo's generalised velocity."""
        self.previous_qpos = self._before[:, self._qpos]
        """Shape (N, nq), one physics step ago."""
        self.previous_qvel = self._before[:, self._qvel]
        """Shape (N, nv), one physics step ago."""
        self.acceleration = np.zeros((count, model.nv))
        """Shape (N, nv), of the latest physics step."""
        self.now = PhysicalStates(self._state, self.time, self.qpos, self.qvel, self.acceleration)
        """The present, in views."""
        # The last periods, the newest last, of `past`; and the first state of what is kept before them.
        self._periods = -(-(longest_delay + 2) // steps) if longest_delay else 0
        self._line = np.zeros((self._periods, count, steps, width))
        self._controls = np.zeros((self._periods, count, steps, model.nu))
        self._advanced: tuple[FloatArray, FloatArray, FloatArray, IndexArray] | None = None
        self._data = [mujoco.MjData(model) for _ in range(threads)]
        # A pool of one thread would only hand its work over.
        self._rollout = rollout.Rollout(nthread=threads if threads > 1 else 0)
        self.is_closed = False
        """True once `close` was called: there are no threads any more."""

    def set(self, indices: IndexArray, qpos: FloatArray, qvel: FloatArray) -> None:
        """Put some environments into a state at time 0, nothing remembered."""
        self._state[indices] = 0.0
        self._state[indices, self._qpos] = qpos
        self._state[indices, self._qvel] = qvel
        self._before[indices] = self._state[indices]
        self.acceleration[indices] = 0.0
        self._line[:, indices] = self._state[indices, None]

    def speed_up(self, where: slice, velocity: FloatArray) -> None:
        """Add to some generalised velocities, shape (N, k), of the present."""
        self.qvel[:, where] += velocity

    def advance(self, control: FloatArray, wrench: FloatArray | None, chosen: IndexArray | None) -> BoolArray:
        """Take `steps` physics steps.

        Args:
            control: shape (N, steps, n), of the actuators.
            wrench: shape (N, 6), N and N·m, on the push body for all of these steps, world frame; None for none.
            chosen: shape (k,), the environments that advance; None for all.

        Returns:
            Shape (k,) or (N,), those of them whose simulation broke: their state is what it was.
        """
        everyone = chosen is None
        count = len(self._state) if chosen is None else len(chosen)
        if not count:
            return np.zeros(0, dtype=np.bool_)
        initial = self._state.copy() if everyone else self._state[chosen]
        actuated = control
        if wrench is not None:
            control = self._with_wrench(control, wrench)
        path = self._path[:count]
        self._rollout.rollout(
            self._pool.select(chosen),
            self._data,
            initial,
            control if everyone else control[chosen],
            control_spec=_CONTROL if wrench is None else _CONTROL_AND_WRENCH,
            skip_checks=True,
            nstep=self._steps,
            initial_warmstart=self.acceleration if everyone else self.acceleration[chosen],
            state=path,
        )
        indices = np.arange(count) if chosen is None else chosen
        self._advanced = initial, path, actuated if everyone else actuated[chosen], indices
        last, before = path[:, -1], path[:, -2] if self._steps > 1 else initial
        # MuJoCo stops an environment at its first warning of a bad state: then its clock is behind.
        expected = initial[:, 0] + (self._steps - 0.5) * self._timestep
        broken: BoolArray = ~((last[:, 0] > expected) & np.isfinite(last).all(axis=1))
        rows: slice | IndexArray = slice(None)
        if chosen is not None or broken.any():
            sound = ~broken
            rows = np.flatnonzero(sound) if chosen is None else chosen[sound]
            last, before, path = last[sound], before[sound], path[sound]
        for line, newest in ((self._line, path), (self._controls, actuated[rows])) if self._periods else ():
            line[:-1, rows] = line[1:, rows]
            line[-1, rows] = newest
        self._state[rows] = last
        self._before[rows] = before
        self.acceleration[rows] = (last[:, self._qvel] - before[:, self._qvel]) / self._timestep
        return broken

    def latest(self) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Yield, of each environment that took part in the latest `advance`, its index, its path and its controls.

        The path is of shape (steps + 1, …), the states before the first step and after each; the controls are of
        shape (steps, n). Valid until the next `advance`.
        """
        if self._advanced is not None:
            initial, path, control, indices = self._advanced
            for row, i in enumerate(indices.tolist()):
                yield i, np.concatenate([initial[row][None], path[row]]), control[row]

    def past(self, delay: IndexArray) -> tuple[PhysicalStates, PhysicalStates, FloatArray]:
        """Return where the robots were some physics steps ago, but not before their start.

        Args:
            delay: shape (N,), physics steps, at most the longest that was announced.

        Returns:
            Their states then, shape (N, …); those one physics step before; and the controls of that step, (N, n).
        """
        if not self._periods:
            return self.now, self.now, np.zeros((len(delay), self._controls.shape[-1]))
        everyone, steps = np.arange(len(delay)), self._steps
        last = self._periods * steps - 1 - delay
        then, before = (self._line[i // steps, everyone, i % steps] for i in (last, last - 1))
        acceleration = (then[:, self._qvel] - before[:, self._qvel]) / self._timestep
        control = self._controls[last // steps, everyone, last % steps]
        return self._states(then, acceleration), self._states(before, acceleration), control

    def _states(self, full: FloatArray, acceleration: FloatArray) -> PhysicalStates:
        return PhysicalStates(full, full[:, 0], full[:, self._qpos], full[:, self._qvel], acceleration)

    def snapshot(self) -> tuple[FloatArray, ...]:
        """Return copies of the states and of what is remembered of the steps before, for `restore`."""
        arrays = self._state, self._before, self.acceleration, self._line, self._controls
        return tuple(array.copy() for array in arrays)

    def restore(self, snapshot: Sequence[FloatArray]) -> None:
        """Take over a snapshot of as many states; views into them stay valid."""
        self._state[:], self._before[:], self.acceleration[:], self._line[:], self._controls[:] = snapshot

    def measure(
        self,
        model: mujoco.MjModel,
        data: Sequence[mujoco.MjData],
        states: FloatArray,
        control: FloatArray,
        control_spec: int = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED),
    ) -> FloatArray:
        """Return what the sensors of any model measure: shape (N, nsensordata), a new array.

        Args:
            data: of that model, one per thread.
            states: shape (N, …), full physics states of that model.
            control: shape (N, …), user inputs of that model.
            control_spec: which they are; generalised forces that act on it, unless it says otherwise.
        """
        sensordata = np.empty((len(control), 1, model.nsensordata))
        self._rollout.rollout(
            [model] * len(control),
            data,
            states,
            control[:, None],
            control_spec=control_spec,
            skip_checks=True,
            nstep=1,
            sensordata=sensordata,
        )
        return sensordata[:, 0]

    def _with_wrench(self, control: FloatArray, wrench: FloatArray) -> FloatArray:
        """Return controls followed by the wrenches on all bodies, as MuJoCo orders them."""
        nominal = self._pool.nominal
        if self._pushed is None:
            self._pushed = np.zeros((*control.shape[:2], nominal.nu + 6 * nominal.nbody))
        self._pushed[:, :, : nominal.nu] = control
        first = nominal.nu + 6 * self._push_body
        self._pushed[:, :, first : first + 6] = wrench[:, None]
        return self._pushed

    def close(self) -> None:
        """Stop the threads. May be called twice."""
        if not self.is_closed:
            self.is_closed = True
            self._rollout.close()
