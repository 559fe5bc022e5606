"""A program that holds a robot whose motors need a guardian: `guarded_robot.py CHANNEL`.

The Lite's motors stand in for such a family: the guardian is told frames, and knows no family.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from humanoid_sim.hardware.adapter import guarding, wiring
from humanoid_sim.hardware.adapter.robot import HardwareRobot
from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.hardware.guardian.plan import GuardianPlan
from humanoid_sim.hardware.motors import MotorGroup, Rescue
from humanoid_sim.hardware.robstride.commands import encode_command
from humanoid_sim.hardware.robstride.messages import OperationControl, Stop
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import FAMILIES

PERIOD = 0.02
DAMPING_TIME = 0.8


def _rescue(motors: MotorGroup, damping: FloatArray) -> list[Rescue]:
    return [
        (
            (encode_command(OperationControl(motor_id, 0.0, 0.0, 0.0, 0.0, float(gain)), model),),
            (encode_command(Stop(motor_id), model),),
        )
        for motor_id, model, gain in zip(motors.motor_id, motors.model, damping, strict=True)
    ]


def without_timeout(set_attribute: Callable[[object, str, object], None]) -> None:
    """Let the adapter take the Lite's motors for ones that go on for ever."""
    set_attribute(wiring, "FAMILIES", {**FAMILIES, "robstride": replace(FAMILIES["robstride"], has_timeout=False)})
    driver = replace(DRIVERS["robstride"], rescue=_rescue)
    set_attribute(guarding, "DRIVERS", MappingProxyType({**DRIVERS, "robstride": driver}))
    set_attribute(guarding, "GuardianPlan", partial(GuardianPlan, damping_time=DAMPING_TIME))


def make_robot(channel: str) -> HardwareRobot:
    description = load_robot("lite")
    offsets = dict.fromkeys(description.joint_names, 0.0)
    return HardwareRobot(description, [channel], calibration=offsets, allow_no_timeout=True)


def hold(robot: HardwareRobot) -> None:
    """One tick: hold the joints where they are."""
    state, _ = robot.read()
    zeros = np.zeros(len(robot.joints))
    robot.write(MITCommand(state.joint_position, zeros, zeros, zeros + 30.0, zeros + 1.0))


def main(channel: str) -> None:
    without_timeout(setattr)
    robot = make_robot(channel)
    robot.activate()
    print("holding", flush=True)
    before = ()
    while True:
        hold(robot)
        _, statuses = robot.read()
        now = tuple(f"{status.level.name} {status.message}" for status in statuses if status.source == "guardian")
        if now != before:
            print(" | ".join(now) or "fine", flush=True)
            before = now
            if "reactivate" in sys.argv and now and "taken over" in now[0]:
                robot.activate()
                print("reactivated", flush=True)
            elif "close" in sys.argv and now and "taken over" in now[0]:
                break
        time.sleep(PERIOD)
    robot.close()
    print("closed", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
