"""Distance of a plant from the truth, on a robot and a motion: what the implicit plant's long steps cost.

The truth is the solution that the plants come to as their steps get shorter: the affine plant at a sixteenth of the
robot's own step. Every plant is given the same commands, those of a policy that followed its motion on the affine
plant, so the difference is the plant's alone. A floating base hangs on its support: without it a small difference would
grow to a different fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import mujoco
import numpy as np

from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.evaluation.errors import length, rms
from humanoid_sim.evaluation.rollout import ClosedLoop, OneRobot
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import body_ids
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.simulation.plant import Actuation, timestep_of

_CONVERGED = 16
"""Steps of the converged solution in one of the robot's own."""


@dataclass(frozen=True, slots=True, eq=False)
class CommandedMotion:
    """Commands of a policy, step by step."""

    description: RobotDescription
    """With the policy's gains, in its default pose."""
    commands: tuple[MITCommand, ...]
    """Shape (n,) each, of one `period`."""
    period: float
    """s"""


@dataclass(frozen=True, slots=True)
class PlantError:
    """A plant's distance from the converged solution over a motion."""

    actuation: Actuation
    timestep: float
    """s"""
    hands_rms: float
    """m, of the bodies that the robot's description calls its hands (the feet of a robot of legs); of a robot without
    any: NaN."""
    hands_most: float
    """m"""
    joints_rms: float
    """rad"""
    joints_most: float
    """rad"""
    speed: float
    """Simulated over wall time."""


def commanded_motion(
    description: RobotDescription,
    wiring: PolicyWiring,
    policy: Policy,
    seconds: float,
    velocity: Sequence[float] = (0.0, 0.0, 0.0),
) -> CommandedMotion:
    """Let a policy run on the affine plant for some seconds, and keep its commands.

    The description has the policy's gains. The velocity, shape (3,), vx and vy in m/s and yaw rate in rad/s, is for a
    policy that walks.
    """
    contract = wiring.contract
    robot = MujocoRobot(
        description,
        control_period=contract.policy_dt,
        actuation="affine",
        anchor_body=contract.anchor_body,
        velocity_at=contract.velocity_points,
        height_scan=contract.height_scan,
    )
    loop = ClosedLoop(OneRobot(robot), wiring, np.array(velocity, dtype=np.float64))
    commands = []
    for _ in range(max(round(seconds / contract.policy_dt), 1)):
        action = np.asarray(policy(loop.observation, int(loop.memory.frame)), dtype=np.float32)
        if not wiring.accepts(action):
            break
        commands.append(loop.act(action))
    return CommandedMotion(description, tuple(commands), contract.policy_dt)


def plant_errors(motion: CommandedMotion, plants: Sequence[tuple[Actuation, float | None]]) -> tuple[PlantError, ...]:
    """Give the commands to plants, each with a physics step in s or its own, and compare where they go.

    Raises `InputError` if gains are unstable on a plant, or its step does not divide the policy's.
    """
    own = timestep_of(motion.description, "affine")
    true_joints, true_hands, _ = _run(motion, "affine", own / _CONVERGED)
    errors = []
    for actuation, given in plants:
        timestep = timestep_of(motion.description, actuation, given)
        joints, hands, speed = _run(motion, actuation, timestep)
        away, off = length(hands - true_hands), np.abs(joints - true_joints)
        errors.append(PlantError(actuation, timestep, *_rms_and_most(away), *_rms_and_most(off), speed))
    return tuple(errors)


def _rms_and_most(values: FloatArray) -> tuple[float, float]:
    """Return both of all values; NaN without any."""
    return (float(rms(values.ravel())), float(values.max())) if values.size else (np.nan, np.nan)


def _run(motion: CommandedMotion, actuation: Actuation, timestep: float) -> tuple[FloatArray, FloatArray, float]:
    """Joints (T, n), rad, and hands (T, h, 3), m, at the end of each command; and simulated over wall time."""
    robot = MujocoRobot(
        motion.description, control_period=motion.period, physics_timestep=timestep, actuation=actuation
    )
    bodies = list(body_ids(robot.model, motion.description.hands))
    data = mujoco.MjData(robot.model)
    joints, hands, wall = [], [], 0.0
    for command in motion.commands:
        begin = perf_counter()
        robot.write(command)
        wall += perf_counter() - begin
        state, _ = robot.read()
        joints.append(state.joint_position)
        data.qpos[:] = robot.qpos
        mujoco.mj_kinematics(robot.model, data)
        hands.append(data.xpos[bodies].copy())
    return np.array(joints), np.array(hands), len(motion.commands) * motion.period / max(wall, 1e-9)
