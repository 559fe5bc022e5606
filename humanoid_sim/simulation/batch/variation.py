"""The models of a batch made as different as a randomisation says: masses, frictions, limits, gravity."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.batch.draws import Draws
from humanoid_sim.simulation.batch.physics import ModelPool

IndexArray = npt.NDArray[np.intp]

_INERTIAL = "mass", "centre_of_mass", "payload", "armature"
"""Fields after which MuJoCo must derive anew what the solver takes from masses."""
_OF_THE_MODEL = (*_INERTIAL, "friction", "joint_friction", "effort_limit", "motor_strength", "gravity_tilt")


def vary_models(pool: ModelPool, indices: IndexArray, draws: Draws, dof: IndexArray, carriers: IndexArray) -> None:
    """Make models those of their environments' episodes, in place, if any differ; nothing is compiled anew.

    Args:
        pool: of all environments.
        indices: shape (k,), the environments, whose models may have been varied before.
        draws: of all environments.
        dof: shape (n,), the joints' indices into `qvel`; the actuators are in their order.
        carriers: shape (c,), ids of the bodies that carry payload.
    """
    has, nominal = draws.randomisation.has, pool.nominal
    if not len(indices) or not has(*_OF_THE_MODEL):
        return
    pool.separate()
    models = pool.select(indices)
    if has("friction"):
        for model, factor in zip(models, draws.factor("friction", indices)[:, 0], strict=True):
            model.geom_friction[:] = nominal.geom_friction * factor
            model.pair_friction[:] = nominal.pair_friction * factor
    if has("joint_friction"):
        for model, loss in zip(models, draws.factor("joint_friction", indices), strict=True):
            model.dof_frictionloss[dof] = nominal.dof_frictionloss[dof] * loss
    if has("effort_limit", "motor_strength"):
        strength = draws.factor("motor_strength", indices) * draws.factor("effort_limit", indices)
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
    masses = draws.factor("mass", indices)
    loads = draws.quantity("payload", indices)
    armatures = draws.factor("armature", indices)
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
