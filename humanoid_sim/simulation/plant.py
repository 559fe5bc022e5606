"""The plant: MuJoCo stepped under the MIT law, in two forms that agree to rounding, and an approximation of them.

`QfrcPlant` computes the law before every physics step and writes `qfrc_applied`: the reference. `AffinePlant` lets
MuJoCo's own actuators compute it (`affine_law`), so that any number of steps is one native call. They are equal step
for step under the Euler integrator, because neither form's damping enters an implicit term there;
`tests/simulation/test_plant.py` holds them to 1e-9.

`ImplicitPlant` is `AffinePlant` with longer steps: MuJoCo integrates the actuators' damping implicitly, so that it
stays stable. It is made for training, and is an approximation; `make bench` measures its error.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Literal, get_args

import mujoco
import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray, MITCommand, affine_law, mit_torque
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses

Actuation = Literal["qfrc_applied", "affine", "implicit"]
"""The forms of the plant."""
BatchActuation = Literal["affine", "implicit"]
"""Those that many robots at once can have: MuJoCo steps them natively."""
IMPLICIT_TIMESTEP = 0.0025
"""s: physics step of the implicit plant, unless another is given or the robot's own is longer."""

_WATCHED = {
    mujoco.mjtWarning.mjWARN_BADQPOS: "position",
    mujoco.mjtWarning.mjWARN_BADQVEL: "velocity",
    mujoco.mjtWarning.mjWARN_BADCTRL: "command",
    mujoco.mjtWarning.mjWARN_BADQACC: "acceleration",
}
"""Warnings of a simulation that is no longer sound, in the order of MuJoCo's checks, and what each is about."""


class Plant(ABC):
    """A robot's model and data, its joints' torques, and whether the simulation is still sound.

    Joint arrays are shape (n,) in the description's order. Not thread-safe.
    """

    actuation: Actuation

    def __init__(self, model: mujoco.MjModel, description: RobotDescription) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self.addresses = joint_addresses(model, description.joint_names)
        self._initial_position = np.array(description.initial_position)
        scale = description.torque_scale
        self._torque_scale = scale if (scale != 1.0).any() else None
        damps = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
        # The implicit integrator, too, changes the velocity by another acceleration than `qacc`.
        is_implicit = model.opt.integrator != mujoco.mjtIntegrator.mjINT_EULER
        self._is_damped = is_implicit or bool(damps and model.dof_damping.any())
        self.acceleration: FloatArray = np.zeros(model.nv) if self._is_damped else self.data.qacc
        """Shape (nv,), of the latest physics step: by how much it changed the velocity, over its length. MuJoCo's
        `qacc` is another one where joints have damping of their own, which its Euler integrator adds implicitly."""
        self._velocity_before = np.empty(model.nv)
        # Slices, where the joints are adjacent and in order, make views: nothing to gather at each physics step.
        self._qpos_index = _as_slice(self.addresses.qpos)
        self._dof_index = _as_slice(self.addresses.dof)
        self._warnings = tuple((name, self.data.warning[int(kind)]) for kind, name in _WATCHED.items())
        self.reset()

    @abstractmethod
    def apply(self, command: MITCommand) -> None:
        """Put a command, shape (n,), in force from the next physics step on."""

    def _scaled(self, command: MITCommand) -> MITCommand:
        """Return the command with which motors of full strength would give the torque that these give."""
        scale = self._torque_scale
        if scale is None:
            return command
        torques = {name: scale * getattr(command, name) for name in ("effort", "stiffness", "damping")}
        return replace(command, **torques)

    @abstractmethod
    def step(self, count: int) -> None:
        """Advance physics by `count` steps under the command in force."""

    def physics_step(self) -> None:
        """One physics step under the forces that are applied now."""
        if not self._is_damped:
            mujoco.mj_step(self.model, self.data)
            return
        self._velocity_before[:] = self.data.qvel
        mujoco.mj_step(self.model, self.data)
        np.subtract(self.data.qvel, self._velocity_before, out=self.acceleration)
        self.acceleration /= self.model.opt.timestep

    def snapshot(self) -> dict[str, Any]:
        """Return a copy of all that later steps depend on, for `restore` of a plant that was built alike."""
        return {
            "data": copy.copy(self.data),
            "acceleration": self.acceleration.copy(),
            "gains": self.model.actuator_biasprm.copy(),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a snapshot; views into the data stay valid."""
        mujoco.mj_copyData(self.data, self.model, snapshot["data"])
        self.acceleration[:] = snapshot["acceleration"]
        self.model.actuator_biasprm[:] = snapshot["gains"]

    @property
    @abstractmethod
    def effort(self) -> FloatArray:
        """Shape (n,), N·m, joint frame: the torque of the latest physics step, saturated. A view or a copy."""

    @property
    def position(self) -> FloatArray:
        """Shape (n,), rad, joint frame. A view or a copy."""
        position: FloatArray = self.data.qpos[self._qpos_index]
        return position

    @property
    def velocity(self) -> FloatArray:
        """Shape (n,), rad/s, joint frame. A view or a copy."""
        velocity: FloatArray = self.data.qvel[self._dof_index]
        return velocity

    def reset(self) -> None:
        """At rest in the initial position, no command in force, warnings cleared."""
        mujoco.mj_resetData(self.model, self.data)
        self.acceleration[:] = 0.0
        self.data.qpos[self._qpos_index] = self._initial_position

    def fault(self) -> str:
        """Return what is wrong with the simulation, naming the quantity that went wrong first; empty if it is sound."""
        first, count = "", 0
        for quantity, warning in self._warnings:
            if warning.number > count:  # it has been warned of for the most steps
                first, count = quantity, warning.number
        return f"simulation unstable: {first} is not finite, or huge" if first else ""


class QfrcPlant(Plant):
    """`mit_torque` before every physics step."""

    actuation = "qfrc_applied"

    def __init__(self, model: mujoco.MjModel, description: RobotDescription) -> None:
        self._joint_count = description.joint_count
        self._limit = description.torque_scale * description.effort_limit
        self._lower = -self._limit
        self._scratch = np.empty(self._joint_count)
        super().__init__(model, description)
        self._is_contiguous = isinstance(self._qpos_index, slice) and isinstance(self._dof_index, slice)

    def reset(self) -> None:
        """See `Plant.reset`."""
        super().reset()
        self._command = MITCommand.zeros(self._joint_count)

    def apply(self, command: MITCommand) -> None:
        """See `Plant.apply`."""
        self._command = self._scaled(command)

    def snapshot(self) -> dict[str, Any]:
        """See `Plant.snapshot`."""
        return super().snapshot() | {"command": self._command}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """See `Plant.restore`."""
        super().restore(snapshot)
        self._command = snapshot["command"]

    @property
    def effort(self) -> FloatArray:
        """See `Plant.effort`."""
        applied: FloatArray = self.data.qfrc_applied[self._dof_index]
        return applied

    def step(self, count: int) -> None:
        """Step with the torque of the MIT law applied at every step."""
        model, data, command, step = self.model, self.data, self._command, mujoco.mj_step
        limit, lower, scratch = self._limit, self._lower, self._scratch
        gathers = not self._is_contiguous
        # Views into MuJoCo's arrays, or, if the joints are scattered there, copies to be renewed at every step.
        position, velocity, torque = self.position, self.velocity, self.effort
        # Each step is under the torque of its own state. This loop is most of what a control tick costs beyond MuJoCo.
        for remaining in range(count, 0, -1):
            if gathers:
                position, velocity = self.position, self.velocity
            mit_torque(command, position, velocity, limit, out=torque, scratch=scratch, lower=lower)
            if gathers:
                data.qfrc_applied[self._dof_index] = torque
            if remaining > 1:
                step(model, data)
            else:
                self.physics_step()


class AffinePlant(Plant):
    """The law as MuJoCo's affine-bias actuators, one per joint, in order; their gains live in the model."""

    actuation: Actuation = "affine"

    def reset(self) -> None:
        """See `Plant.reset`."""
        super().reset()
        self.model.actuator_biasprm[:, 1:3] = 0.0

    def apply(self, command: MITCommand) -> None:
        """See `Plant.apply`. This writes the gains into `model.actuator_biasprm`."""
        self.model.actuator_biasprm[:, 1:3], self.data.ctrl[:] = affine_law(self._scaled(command))

    @property
    def effort(self) -> FloatArray:
        """See `Plant.effort`."""
        force: FloatArray = self.data.actuator_force
        return force

    def step(self, count: int) -> None:
        """Step with actuators that give the torque of the MIT law."""
        if count > 1:
            mujoco.mj_step(self.model, self.data, count - 1)
        if count:
            self.physics_step()


class ImplicitPlant(AffinePlant):
    """`AffinePlant` whose damping MuJoCo integrates implicitly: stable at steps where explicit damping is not."""

    actuation = "implicit"

    def step(self, count: int) -> None:
        """Step likewise, from the accelerations of a rollout."""
        super().step(count)
        if count:  # as `mujoco.rollout` is told to begin: so one robot goes as it would in a batch
            self.data.qacc_warmstart[:] = self.acceleration


def check_actuation(value: object, accepted: Sequence[str] = get_args(Actuation)) -> None:
    """Refuse what is not a form of the plant. Raises `InputError` naming the value and what is accepted."""
    if value not in accepted:
        raise InputError(f"actuation: is {value!r}, expected {' or '.join([', '.join(accepted[:-1]), accepted[-1]])}")


def timestep_of(description: RobotDescription, actuation: Actuation, given: float | None = None) -> float:
    """Return the physics step in s: what was given, or else what suits robot and plant."""
    own = description.simulation.physics_timestep
    if given is not None:
        return given
    return max(own, IMPLICIT_TIMESTEP) if actuation == "implicit" else own


def mean_delay_steps(description: RobotDescription, timestep: float) -> int:
    """Return the mean of the joints' own delays in physics steps of `timestep`, s."""
    return round(float(description.delay.mean()) / timestep)


def make_plant(
    description: RobotDescription,
    *,
    actuation: Actuation = "qfrc_applied",
    physics_timestep: float | None = None,
) -> Plant:
    """Build the model and its plant.

    Raises `InputError` if `actuation` is unknown, or the model cannot be built (see `build_model`).
    """
    check_actuation(actuation)
    model = build_model(
        description,
        physics_timestep=timestep_of(description, actuation, physics_timestep),
        affine_actuators=actuation != "qfrc_applied",
        implicit=actuation == "implicit",
    )
    return _PLANTS[actuation](model, description)


_PLANTS: Mapping[Actuation, type[Plant]] = MappingProxyType(
    {"qfrc_applied": QfrcPlant, "affine": AffinePlant, "implicit": ImplicitPlant}
)


def _as_slice(index: np.ndarray) -> slice | np.ndarray:
    """`index` as a slice if it counts up by one, else itself."""
    if np.array_equal(index, np.arange(index[0], index[0] + len(index))):
        return slice(int(index[0]), int(index[0]) + len(index))
    return index
