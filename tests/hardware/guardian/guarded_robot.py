"""A program that holds a robot of which four motors need a guardian: `guarded_robot.py CHANNEL`."""

import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from humanoid_sim.hardware.guardian.protocol import GuardianPlan
from humanoid_sim.hardware.robot import HardwareRobot
from humanoid_sim.hardware.sito import motors as sito_motors
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot

PERIOD = 0.02
DAMPING_TIME = 0.8
STIFFNESS = 20.0


def brake_briefly(set_attribute: Callable[[object, str, object], None]) -> None:
    """The tests need not wait for 3 s."""
    set_attribute(sito_motors, "GuardianPlan", partial(GuardianPlan, damping_time=DAMPING_TIME))


def make_robot(channel: str) -> HardwareRobot:
    description = load_robot("lite_sito")
    zeros = dict.fromkeys(description.joint_names, 0.0)
    return HardwareRobot(description, [channel], calibration=zeros, allow_no_timeout=True)


def hold(robot: HardwareRobot) -> None:
    """One tick: pull the joints 0.2 rad away from where they are."""
    state, _ = robot.read()
    zeros = np.zeros(len(robot.joints))
    robot.write(MITCommand(state.joint_position + 0.2, zeros, zeros, zeros + STIFFNESS, zeros + 1.0))


def main(channel: str) -> None:
    brake_briefly(setattr)
    robot = make_robot(channel)
    robot.activate()
    print("holding", flush=True)
    while True:
        hold(robot)
        time.sleep(PERIOD)


if __name__ == "__main__":
    main(sys.argv[1])
