"""A motor model of your own: motors that lose torque as they turn faster, and rub. What does that do to the policy?

    python examples/own_motor.py

A `MotorPlant` is asked for every joint's torque before each physics step, so it may do whatever a motor does. Nothing
else in the stack knows that the motors are others.
"""

from __future__ import annotations

import numpy as np

from humanoid_sim.assets import SAMPLE_POLICY, motion_path
from humanoid_sim.messages import Intent, Mode, TickInput
from humanoid_sim.mit import FloatArray, MITCommand, mit_torque
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.simulation.plant import MotorPlant
from humanoid_sim.stack import build_supervisor

PERIOD = 0.005
"""s, from one tick to the next."""
LITE = load_robot("lite")
LIMIT = np.array(LITE.effort_limit)


class TiredMotors(MotorPlant):
    """Torque falls linearly with speed, to none at 6 rad/s, and half a newton metre is lost to friction."""

    no_load_velocity = 6.0
    """rad/s"""
    friction = 0.5
    """N·m"""

    def torque(self, command: MITCommand) -> FloatArray:
        """See `MotorPlant.torque`."""
        asked = mit_torque(command, self.position, self.velocity, LIMIT)
        speed = self.velocity
        left = LIMIT * np.clip(1.0 - np.abs(speed) / self.no_load_velocity, 0.0, 1.0)
        drives = asked * speed > 0.0  # it brakes with all it has
        given = np.where(drives, np.clip(asked, -left, left), asked)
        return given - self.friction * np.tanh(speed / 0.05)


def tracking_error(motors: type[MotorPlant] | None) -> float:
    """Root mean square of commanded less actual joint positions over four seconds of the policy, rad."""
    policy = load_checkpoint(SAMPLE_POLICY).following(read_motion(motion_path("drum")))
    stack = build_supervisor(LITE, PERIOD, policy)
    robot = MujocoRobot(LITE, control_period=PERIOD, motors=motors)
    robot.activate()
    memory, errors = stack.initial(), []
    script = {0: Intent.DAMP, 10: Intent.LOAD_A, 1000: Intent.START_LOCOMOTION, 1800: Intent.DAMP}
    for tick in range(1900):
        state, safety = robot.read()
        memory, output = stack.step(memory, TickInput(state, safety, (script[tick],) if tick in script else ()))
        robot.write(output.command)
        if output.control_mode.mode is Mode.LOCOMOTION:
            errors.append(output.command.position - state.joint_position)
    robot.close()
    return float(np.sqrt(np.square(errors).mean()))


def main() -> None:
    """Compare."""
    print(f"ideal motors: the joints lag {tracking_error(None):.3f} rad behind their commands")
    print(f"tired motors: the joints lag {tracking_error(TiredMotors):.3f} rad behind their commands")


if __name__ == "__main__":
    main()
