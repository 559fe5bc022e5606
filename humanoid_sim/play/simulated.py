"""The simulated robot of a run."""

from __future__ import annotations

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.robot_parts import RobotParts
from humanoid_sim.play.support import support_listener
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.delay import delay_steps
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

__all__ = ["simulated_robot"]


def simulated_robot(
    config: PlayConfig, description: RobotDescription, control_period: float, anchor_body: str
) -> RobotParts:
    """A robot in MuJoCo.

    Args:
        config: the options.
        description: of the robot.
        control_period: s
        anchor_body: whose pose the policy observes; empty for none.

    Raises:
        InputError: if an option is not accepted.
    """
    settings = description.simulation
    timestep = settings.physics_timestep if config.physics_timestep is None else config.physics_timestep
    for option, delay in (("--command-delay", config.command_delay), ("--state-delay", config.state_delay)):
        delay_steps(option, delay, timestep)
    robot = MujocoRobot(
        description,
        control_period=control_period,
        physics_timestep=timestep,
        actuation=config.actuation,
        command_delay=config.command_delay,
        state_delay=config.state_delay,
        state_sampling=config.state_sampling,
        base_yaw=config.yaw,
        base_height=config.base_height,
        anchor_body=anchor_body,
    )

    def stability(contract: PolicyContract) -> tuple[str, ...]:
        gains = resolve_action(contract, description.joint_names)
        return (robot.stability.check(gains.damping, "policy"),)

    return RobotParts(
        robot,
        live=robot.extern,
        qpos=lambda _: robot.qpos,
        model=lambda: build_model(description),
        simulated=True,
        check_policy=stability,
        mode_listener=support_listener(robot) if description.is_floating else None,
        notices=robot.warnings,
    )
