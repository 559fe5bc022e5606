"""What an environment is about, whatever steps it: a robot, a contract, the motion that it follows, and a task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import ACTION_LIMIT, Policy, PolicyWiring
from humanoid_sim.controllers.rotation import multiply
from humanoid_sim.envs.inputs import Named, read_policy
from humanoid_sim.envs.tasks.choice import TASK_OPTIONS, make_task
from humanoid_sim.envs.tasks.task import Start, Task
from humanoid_sim.errors import FieldError, InputError, known_names
from humanoid_sim.mit import ANCHOR_POSE, BASE_LINEAR_VELOCITY, EXTERN_WIDTHS, VELOCITY_COMMAND, FloatArray
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract
from humanoid_sim.simulation.floating_base import FloatingBase
from humanoid_sim.simulation.plant import make_plant

__all__ = ["Setting", "make_setting"]

_MOST = float(np.finfo(np.float32).max)
"""Of an action limit: an action of float32 that is infinite must be beyond it."""


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """Everything about an environment that does not depend on how many robots there are."""

    description: RobotDescription
    """The robot, with the contract's gains, in the contract's default pose."""
    wiring: PolicyWiring
    """What the policy observes and commands, by the functions of the deployed controller."""
    task: Task
    policy: Policy
    """The checkpoint's; one that answers zeros where there is only a contract."""
    physics_timestep: float
    """s"""
    extern: Mapping[str, int]
    """Names and widths of the live inputs that states carry."""
    _qpos: FloatArray
    """Shape (nq,), the robot standing at rest."""
    _joint_qpos: npt.NDArray[np.intp]
    _joint_dof: npt.NDArray[np.intp]
    _base_quaternion: slice | None
    _dof_count: int

    @property
    def contract(self) -> PolicyContract:
        """Of the policy."""
        return self.wiring.contract

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies whose poses in the base frame the task compares; other motions are joints and an anchor body."""
        return self.contract.body_names if "motion_body_pos_b" in self.wiring.reference.terms else ()

    def generalised(self, start: Start) -> tuple[FloatArray, FloatArray]:
        """MuJoCo's `qpos` (..., nq) and `qvel` (..., nv) of a start."""
        batch = start.joint_position.shape[:-1]
        qpos = np.broadcast_to(self._qpos, (*batch, len(self._qpos))).copy()
        qvel = np.zeros((*batch, self._dof_count))
        qpos[..., self._joint_qpos] = start.joint_position
        qvel[..., self._joint_dof] = start.joint_velocity
        if self._base_quaternion is not None:
            half, zero = 0.5 * start.base_yaw, np.zeros(batch)
            yaw = np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)
            qpos[..., self._base_quaternion] = multiply(yaw, qpos[..., self._base_quaternion])
        return qpos, qvel


def make_setting(
    contract: Named | PolicyContract,
    robot: Named | RobotDescription,
    motion: Named | Motion | None = None,
    *,
    task: str = "auto",
    physics_timestep: float | None = None,
    action_limit: float = ACTION_LIMIT,
    **task_options: Any,
) -> Setting:
    """Read what is named, and check that it fits together.

    Args:
        contract: of the policy, as `read_policy` takes it.
        robot: a description, or what `load_robot` takes.
        motion: what the policy follows, as `read_policy` takes it.
        task: as `make_task` takes it.
        physics_timestep: s; None for the robot's.
        action_limit: largest magnitude of a raw action; beyond it the policy has failed.
        task_options: `weights`, `episode_seconds`, `joint_noise` and `velocity_noise`, as `Task` takes them.

    Raises:
        InputError: one line that says what cannot be read, or what does not fit.
    """
    if not 0.0 < action_limit <= _MOST:
        raise InputError(f"action_limit: is {action_limit}, expected a number > 0 and at most {_MOST:g}")
    for name in task_options:
        if name not in TASK_OPTIONS:
            raise InputError(known_names("task option", name, TASK_OPTIONS))
    described = robot if isinstance(robot, RobotDescription) else load_robot(robot)
    loaded = read_policy(contract, motion, described.joint_names)
    read = loaded.contract
    description = with_contract(described, read)
    estimated = {BASE_LINEAR_VELOCITY: description.is_floating, ANCHOR_POSE: bool(read.anchor_body)}
    extern = {name: width for name, width in EXTERN_WIDTHS.items() if name == VELOCITY_COMMAND or estimated[name]}
    try:
        wiring = PolicyWiring(description.joint_names, read, loaded.reference, extern, action_limit)
    except FieldError as error:
        raise InputError(f"policy on robot '{description.name}': {error}") from None

    timestep = description.simulation.physics_timestep if physics_timestep is None else physics_timestep
    plant = make_plant(description, actuation="affine", physics_timestep=timestep)
    quaternion, height = None, 0.0
    if description.is_floating:
        base = FloatingBase(plant.model, description, plant.data.qpos)
        base.place(plant.data)
        height = float(base.state(plant.data).height)
        first = int(plant.model.jnt_qposadr[plant.model.body_jntadr[plant.model.body(description.base.body).id]])
        quaternion = slice(first + 3, first + 7)
    return Setting(
        description=description,
        wiring=wiring,
        task=make_task(task, description, read, loaded.reference, standing_height=height, **task_options),
        policy=loaded.policy,
        physics_timestep=timestep,
        extern=MappingProxyType(extern),
        _qpos=plant.data.qpos.copy(),
        _joint_qpos=plant.addresses.qpos,
        _joint_dof=plant.addresses.dof,
        _base_quaternion=quaternion,
        _dof_count=int(plant.model.nv),
    )
