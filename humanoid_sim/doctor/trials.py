"""Short simulated runs of a policy under a contract: nothing holds the robot, so a fall is a fall."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.rl_policy import infer
from humanoid_sim.doctor.examined_policy import ExaminedPolicy
from humanoid_sim.doctor.goals import BodiesGoal, Goal, MotionGoal, Strain, VelocityGoal
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.evaluation.failure import has_run_away
from humanoid_sim.evaluation.rollout import ClosedLoop, OneRobot
from humanoid_sim.evaluation.tracking import TrackingErrors
from humanoid_sim.messages import SafetyLevel
from humanoid_sim.mit import EXTERN_WIDTHS
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.robots.description import with_contract, with_joint_limits
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

_ROBOTS = 64
"""Simulated robots that are kept: each takes about 1 MB."""
_TIMESTEPS = (0.005, 0.0025, 0.002, 0.001, 0.0005)
"""s, longest first. Where damping is stable the longest gives the figures of the shortest, and costs a tenth."""
_STABLE = 1.5
"""Limit for the gains at the physics step; see `humanoid_sim.simulation.stability`."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One way to try a contract."""

    seconds: float
    command: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """vx, vy in m/s and yaw rate in rad/s."""
    yaw: float = 2.0
    """rad, heading at the start: far from 0, where world and body frames would agree."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one trial."""

    time_up: float
    """Time for which the robot stayed up, s; at most `seconds`."""
    seconds: float
    """Length of the trial, s."""
    quality: Mapping[str, float]
    """Parts of the run's quality by name; each is about 1 where an onlooker would begin to notice."""
    lost: str = ""
    """Way in which the robot was lost; empty if it was not."""

    @property
    def cost(self) -> float:
        """The parts' sum: smaller is better."""
        return sum(self.quality.values())


@dataclass
class TrialRunner:
    """Tries contracts on an examined policy. Simulated robots are kept and used again. Not thread-safe."""

    examined: ExaminedPolicy
    _robots: OrderedDict[tuple[object, ...], MujocoRobot] = field(default_factory=OrderedDict)
    """Robots in order of use, the latest last."""
    _stable: dict[tuple[object, ...], bool] = field(default_factory=dict)
    """Stability of each robot with its gains and a physics step: True if they go together."""

    def run(self, contract: PolicyContract, trial: Trial) -> Outcome:
        """Try a contract once. A contract that cannot run is lost at 0 s; the same trial gives the same outcome."""
        try:
            loaded = self.examined.load(contract)
            robot = self._robot(contract, trial)
            extern = {**loaded.extern, **EXTERN_WIDTHS}
            robot.activate()
            contract = with_joint_limits(contract, robot.description)
            wiring = PolicyWiring(robot.joints, contract, loaded.reference, extern)
            one = OneRobot(robot)
            loop = ClosedLoop(one, wiring, np.array(trial.command))
        except (FieldError, InputError) as error:
            return Outcome(0.0, trial.seconds, {}, str(error))
        return _run(one, loop, loaded.policy, self._goal(loaded, trial, robot), trial)

    def _goal(self, loaded: LoadedPolicy, trial: Trial, robot: MujocoRobot) -> Goal:
        contract, motion = loaded.contract, self.examined.motion_under(loaded.contract)
        if contract.task_type == "locomotion" and robot.base_state is not None:
            return VelocityGoal(np.array(trial.command), contract.policy_dt)
        if "reference_joint_pos" in loaded.reference.terms:
            return MotionGoal(contract, loaded.reference, self._base_reference, robot.joints)
        if contract.task_type == "tracking" and motion is not None and motion.body_names:
            errors = TrackingErrors(robot.description, motion.frames, motion.body_names, contract.policy_dt)
            return BodiesGoal(errors)
        return Goal()

    @cached_property
    def _base_reference(self) -> MotionReference | None:
        return self.examined.base_reference()

    def _robot(self, contract: PolicyContract, trial: Trial) -> MujocoRobot:
        """Give a simulation of the robot in the contract's default pose, with a physics step that suits its damping."""
        order = np.argsort(contract.joint_names)
        limits = contract.effort_limit
        efforts = None if limits is None else limits[order].tobytes()
        built = contract.default_joint_pos[order].tobytes(), contract.model_joint_damping, efforts
        gains = contract.joint_damping, contract.joint_stiffness
        damped = *built, *(each[order].tobytes() for each in gains)
        for timestep in _TIMESTEPS:
            try:
                steps_per_period(contract.policy_dt, timestep)
            except InputError:
                continue
            if not self._stable.get((*damped, timestep), True):
                continue
            observed = contract.anchor_body, contract.velocity_points, contract.height_scan
            key = (*built, contract.policy_dt, observed, trial.yaw, timestep)
            robot = self._robots.pop(key, None) or self._build(contract, trial, timestep)
            self._robots[key] = robot
            if len(self._robots) > _ROBOTS:
                self._robots.popitem(last=False)
            if (*damped, timestep) not in self._stable:
                own = [contract.joint_names.index(name) for name in robot.joints]
                self._stable[*damped, timestep] = robot.stability.suits(gains[0][own], gains[1][own], _STABLE)
            if self._stable[*damped, timestep]:
                return robot
        raise InputError("its damping is unstable in simulation")

    def _build(self, contract: PolicyContract, trial: Trial, timestep: float) -> MujocoRobot:
        # Gains come with every command; a description without any passes the robot's own check of them.
        zeros = np.zeros(len(contract.joint_names))
        still = replace(contract, joint_stiffness=zeros, joint_damping=zeros)
        return MujocoRobot(
            with_contract(self.examined.description, still),
            control_period=contract.policy_dt,
            physics_timestep=timestep,
            actuation=self.examined.actuation,
            support=False,
            base_yaw=trial.yaw,
            base_height=self.examined.base_height,
            anchor_body=contract.anchor_body,
            velocity_at=contract.velocity_points,
            height_scan=contract.height_scan,
        )


def _run(one: OneRobot, loop: ClosedLoop, policy: Policy, goal: Goal, trial: Trial) -> Outcome:
    """One trial from its start: a policy step per control period."""
    period = loop.wiring.contract.policy_dt
    strain, time_up = Strain(period), trial.seconds
    for step in range(max(round(trial.seconds / period), 1)):
        state = loop.state
        lost = goal.update(int(loop.memory.frame), state, one.robot.base_state)
        if one.safety.level >= SafetyLevel.FAULT:
            lost = one.safety.message
        elif has_run_away(state.joint_velocity):  # before it counts as a fall that they are anywhere
            lost = "the joints run away"
        inferred = infer(loop.wiring, policy, loop.observation, int(loop.memory.frame))
        if isinstance(inferred, Fault):
            lost = lost or inferred.message
        if lost or isinstance(inferred, Fault):
            time_up = step * period
            break
        strain.update(state, loop.act(inferred.action))
    return Outcome(time_up, trial.seconds, {**goal.parts(), **strain.parts()}, lost)
