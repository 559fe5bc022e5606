"""The state in which a recorded run began to follow its policy: its commands up to there, to a plant like its own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.envs.episode_robot import PlantState
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import MITState
from humanoid_sim.recording.reader import Recording, open_recording
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

__all__ = ["recorded_start"]

_FREE = (Mode.LOCOMOTION, Mode.REMOTE)
"""Modes in which no support holds a floating base."""


def recorded_start(path: str | Path, description: RobotDescription) -> tuple[PlantState, MITState]:
    """The plant and the robot's report in the tick in which LOCOMOTION began, bit for bit.

    Args:
        path: a recording of `play` in simulation.
        description: the robot, whose model lies where the recorded one's did.

    Raises:
        InputError: it is no such recording, LOCOMOTION never began, or the plant does not repeat the recorded states.
    """
    recording = open_recording(path)
    robot = _recorded_robot(recording, description)
    for tick in recording.ticks():
        mode = tick.output.control_mode.mode
        if robot.base_state is not None and robot.supported is (mode in _FREE):
            robot.set_support(mode not in _FREE)
        if mode is Mode.LOCOMOTION:
            _check(recording, robot, tick)
            return PlantState.of(robot), tick.input.state
        robot.write(tick.output.command)
    raise InputError(f"{path}: never comes to LOCOMOTION, so there is no start to take from it")


def _recorded_robot(recording: Recording, description: RobotDescription) -> MujocoRobot:
    header = recording.header
    try:
        recorded = RobotDescription.from_json(header.documents["robot"], description.folder)
        options: dict[str, Any] = json.loads(header.documents["settings"])["options"]
        names = ("physics_timestep", "actuation", "base_height")
        chosen = {name: options[name] for name in names} | {"base_yaw": options["yaw"]}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{recording.path}: is no recording of play in simulation: its header lacks {error}") from None
    if recorded.joint_names != description.joint_names:
        raise InputError(f"{recording.path}: is of the robot '{recorded.name}', the environment's '{description.name}'")
    return MujocoRobot(recorded, control_period=header.control_period, **chosen)


def _check(recording: Recording, robot: MujocoRobot, tick: TickRecord) -> None:
    state, _ = robot.read()
    for name in ("joint_position", "joint_velocity", "imu_quaternion"):
        difference = np.abs(getattr(state, name) - getattr(tick.input.state, name)).max()
        if difference != 0.0:
            raise InputError(
                f"{recording.path}: its {name} at LOCOMOTION is not repeated, it is {difference:.2g} off; expected a "
                "run without delays, of this robot and version of MuJoCo"
            )
