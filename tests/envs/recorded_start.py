"""The state in which a recorded simulation came to LOCOMOTION, reached by simulating it again."""

from pathlib import Path
from typing import Any

from humanoid_sim.envs.episode_robot import PlantState
from humanoid_sim.messages import Mode
from humanoid_sim.mit import VELOCITY_COMMAND
from humanoid_sim.recording.reader import open_recording, recorded_settings
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import support_in_mode
from humanoid_sim.simulation.mujoco_robot import MujocoRobot


def recorded_start(path: str, description: RobotDescription) -> dict[str, Any]:
    """Return options for `PolicyEnv.reset`; the robot's model lies where the recorded one's did."""
    recording = open_recording(path)
    header = recording.header
    options = recorded_settings(Path(path), header)["options"]
    robot = MujocoRobot(
        RobotDescription.from_json(header.documents["robot"], description.folder),
        control_period=header.control_period,
        base_yaw=options["yaw"],
        **{name: options[name] for name in ("physics_timestep", "actuation", "base_height", "drop")},
    )
    for tick in recording.ticks():
        mode = tick.output.control_mode.mode
        if robot.base_state is not None:
            support_in_mode(robot, mode)
        if mode is Mode.LOCOMOTION:
            live = tick.input.state.extern.get(VELOCITY_COMMAND)
            command = (0.0, 0.0, 0.0) if live is None else live.value
            return {"state": PlantState.of(robot), "command": command}
        robot.write(tick.output.command)
    raise AssertionError(f"{path} never comes to LOCOMOTION")
