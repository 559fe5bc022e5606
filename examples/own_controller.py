"""A controller of your own in LOCOMOTION's place, on the simulated Lite: its hands sway, and a wrong angle is a fault.

    python examples/own_controller.py

A controller is a frozen configuration with two pure functions. What it remembers goes into its memory. An error is a
`Fault`, never an exception: its fallback then commands the robot in the same tick. `fuzz_controller` of
`humanoid_sim.testing` attacks it with every input that may ever reach it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.base import RL_POLICY, Fault, Memory
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, TickInput
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import build_supervisor

PERIOD = 0.005  # s, from one tick to the next


@dataclass(frozen=True, slots=True, eq=False)
class SwayMemory(Memory):
    """Where and when it began."""

    time: float = 0.0  # s
    position: FloatArray | None = None  # shape (n,), rad


@dataclass(frozen=True, slots=True, eq=False)
class Sway:
    """Moves some joints to and fro around where they are when it takes over; the others stay."""

    joints: tuple[str, ...]
    swaying: tuple[str, ...]
    amplitude: float = 0.2  # rad
    seconds: float = 2.0  # s, of one period

    def activate(self, tick_input: TickInput) -> SwayMemory | Fault:
        """Remember the pose; refuse one that is not known."""
        state = tick_input.state
        if not np.isfinite(state.time) or not (np.abs(state.joint_position) < 2.0 * math.pi).all():
            return Fault("the time, or a joint's position, is not known")
        return SwayMemory(time=float(state.time), position=state.joint_position)

    def update(self, memory: SwayMemory, tick_input: TickInput) -> tuple[SwayMemory, MITCommand] | Fault:
        """One tick."""
        elapsed = float(tick_input.state.time) - memory.time
        if not 0.0 <= elapsed < 1e6:
            return Fault(f"the clock is {elapsed:g} s after the beginning")
        assert memory.position is not None
        moves = np.array([joint in self.swaying for joint in self.joints])
        sway = np.where(moves, self.amplitude * math.sin(2.0 * math.pi * elapsed / self.seconds), 0.0)
        zeros = np.zeros(len(self.joints))
        return memory, MITCommand(memory.position + sway, zeros, zeros, stiffness=zeros + 50.0, damping=zeros + 2.0)


def main() -> None:
    """Take the robot through the modes, as an operator would, and print what happens."""
    lite = load_robot("lite")
    sound = build_supervisor(lite, PERIOD, None)
    sway = Sway(lite.joint_names, ("left_wrist_yaw", "right_wrist_yaw"))
    stack = Supervisor(lite.joint_names, {**sound.controllers, RL_POLICY: sway}, guards=sound.guards)
    robot = SimRobot(lite, SimConfig(control_period=PERIOD))
    robot.activate()
    memory, mode = stack.initial(), ""
    wrist, angles = lite.joint_names.index("left_wrist_yaw"), []
    script = {0: Intent.DAMP, 10: Intent.LOAD_A, 1000: Intent.START_LOCOMOTION, 1800: Intent.DAMP}
    for tick in range(1900):
        state, safety = robot.read()
        memory, output = stack.step(memory, TickInput(state, safety, (script[tick],) if tick in script else ()))
        robot.write(output.command)
        now = f"{output.control_mode.mode.name} ({output.control_mode.controller_name})"
        if now != mode:
            print(f"{state.time:6.2f} s  {now}")
            mode = now
        if output.control_mode.controller_name == RL_POLICY:
            angles.append(float(state.joint_position[wrist]))
    robot.close()
    print(f"left_wrist_yaw swayed from {min(angles):.2f} to {max(angles):.2f} rad")


if __name__ == "__main__":
    main()
