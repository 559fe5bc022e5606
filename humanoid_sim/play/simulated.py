"""The simulated robot of a run."""

from __future__ import annotations

from collections.abc import Callable

from humanoid_sim.messages import Mode
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.robot_parts import RobotParts
from humanoid_sim.robots.description import RobotDescription
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
    robot = MujocoRobot(
        description,
        control_period=control_period,
        physics_timestep=config.physics_timestep,
        actuation=config.actuation,
        command_delay=config.command_delay,
        state_delay=config.state_delay,
        state_sampling=config.state_sampling,
        base_yaw=config.yaw,
        base_height=config.base_height,
        anchor_body=anchor_body,
    )
    return RobotParts(
        robot,
        live=robot.extern,
        qpos=lambda: robot.qpos,
        model=lambda: build_model(description),
        simulated=True,
        check_gains=lambda _, damping: robot.stability.check(damping, "policy"),
        mode_listener=_support(robot) if description.is_floating else None,
        notices=robot.warnings,
    )


def _support(robot: MujocoRobot) -> Callable[[Mode], str]:
    """Let a free-standing robot go when a policy takes over, and hold it again when it no longer balances."""

    def listen(mode: Mode) -> str:
        held = mode not in (Mode.LOCOMOTION, Mode.REMOTE)
        if held == robot.supported:
            return ""
        robot.set_support(held)
        return "support holds the base where it is" if held else "support released"

    return listen
