from dataclasses import replace

import numpy as np

from humanoid_sim.frontends.console.showing import motor_table
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
STATE = replace(MITState.unknown(14), joint_age=np.array([0.004] * 13 + [np.inf]))
RECORD = TickRecord(0, TickInput(STATE), TickOutput(MITCommand.zeros(14), ControlMode(Mode.DAMPING, "")), 1e-3, False)


def test_of_each_motor_what_is_known():
    robot = {
        "temperature": {"left_elbow_pitch": 136.2, "left_wrist_yaw": 31.0},
        "faults": {"left_elbow_pitch": ["motor_overtemperature", "silent"]},
        "channels": [{"source": "can0"}, {"source": "can1"}],
    }
    told = motor_table(LITE, robot, {"can0": 0.2}, RECORD)
    assert [motor["name"] for motor in told["motors"]] == list(LITE.joint_names)
    assert told["motors"][3] == {
        "name": "left_elbow_pitch",
        "temperature": 136.2,
        "warning": 135.0,
        "heard": 0.004,
        "faults": ["motor_overtemperature", "silent"],
    }
    assert (told["motors"][4]["temperature"], told["motors"][4]["faults"]) == (31.0, [])
    assert (told["motors"][0]["temperature"], told["motors"][13]["heard"]) == (None, np.inf)
    assert told["buses"] == [{"name": "can0", "load": 0.2}, {"name": "can1", "load": None}]


def test_in_simulation_there_are_no_motors():
    assert motor_table(LITE, None, {}, RECORD) is None
