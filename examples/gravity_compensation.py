"""Hold a robot's arms against gravity, from outside, over DDS: `python examples/gravity_compensation.py`.

In REMOTE (the gamepad's button, or `python -m humanoid_sim.mode start_remote`) the arms are held: in the effort form
they can be led by hand and stay where they are let go, in the PD form they keep their pose. See docs/dds-client.md.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from humanoid_sim.cli import parse, run_program
from humanoid_sim.dds_client import RobotClient
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.kinematics import GravityTorque


@dataclass(frozen=True)
class Options:
    """Compensate gravity in REMOTE, over DDS."""

    form: Literal["effort", "pd"] = "effort"
    """effort: gravity's torque, no stiffness, a little damping; pd: a position with which the gains carry it."""
    robot: str = "lite"
    """Robot of the model to use: a shipped robot, or the path of a robot's YAML file or MJCF."""
    damping: float = 1.0
    """N·m·s/rad, of the effort form."""


def command(robot: RobotDescription, position: FloatArray, torque: FloatArray, form: str, damping: float) -> MITCommand:
    """Return what holds a position, shape (n,), rad, against gravity's torque, shape (n,), N·m."""
    zeros = np.zeros_like(position)
    if form == "effort":
        return MITCommand(position, zeros, torque, zeros, np.full_like(position, damping))
    return MITCommand(position + torque / robot.stiffness, zeros, zeros, robot.stiffness, robot.damping)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until it is interrupted, or the robot falls silent."""
    options = parse(Options, "examples/gravity_compensation.py", arguments)
    robot = load_robot(options.robot)
    gravity = GravityTorque(robot)  # a model of our own; its torque is within the motors' limits
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopped.append(number))

    with RobotClient(robot.topic_prefix or robot.name) as client:
        print("waiting for the robot", flush=True)
        state = None
        while state is None and not stopped:
            state = client.state()
        if state is not None and state.names != robot.joint_names:
            raise InputError(f"--robot: {robot.name} has not the joints of the robot on DDS: {', '.join(state.names)}")
        hold: FloatArray | None = None
        was_remote: bool | None = None
        while state is not None and not stopped:
            mode = client.control_mode()
            is_remote = mode is not None and mode.mode is Mode.REMOTE
            if np.isfinite(state.position).all():
                if hold is None or not (is_remote and was_remote):
                    hold = state.position  # in the end the pose in which REMOTE begins
                if was_remote != is_remote:
                    print("REMOTE: holding" if is_remote else "ready; waiting for REMOTE", flush=True)
                was_remote = is_remote
                position = hold if options.form == "pd" else state.position
                client.command(command(robot, position, gravity(position), options.form, options.damping))
            state = client.state()
    print("the robot fell silent" if state is None else "stopped", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
