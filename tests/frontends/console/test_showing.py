"""What the page shows beside the modes: a piano's keys, and the motors."""

from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.frontends.console import showing
from humanoid_sim.frontends.console.showing import ShownKeys, motor_table
from humanoid_sim.messages import ControlMode, Mode, PolicyStep, SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import Extern, MITCommand, MITState
from humanoid_sim.robots.description import load_robot


class Loaded:
    """As much of a piano policy as is looked at: key 39 in frame 0, keys 39 and 43 in frame 1."""

    def __init__(self):
        goals = np.zeros((2, 88), dtype=np.float32)
        goals[:, 39] = goals[1, 43] = 1.0
        self.reference = type("Reference", (), {"terms": {"target_keys": goals}})


@pytest.fixture
def shown(monkeypatch):
    monkeypatch.setattr(showing, "recorded_policy", lambda *_: Loaded())
    return ShownKeys(SessionHeader("three", ("a",), 0.005, 0, {}))


def tick(local, keys, frame=None):
    """A tick in which those keys are heard, in LOCOMOTION if the policy takes a step."""
    record = local.tick()
    extern = {} if keys is None else {"key_pressed": keys}
    state = replace(record.input.state, extern=extern)
    step = None if frame is None else PolicyStep(frame, np.zeros(1), np.zeros(1))
    mode = ControlMode(Mode.DAMPING if frame is None else Mode.LOCOMOTION, "any", "")
    output = replace(record.output, policy_step=step, control_mode=mode)
    return replace(record, input=replace(record.input, state=state), output=output)


def pressed(time, *keys):
    values = np.zeros(88)
    values[list(keys)] = 1.0
    return Extern(values, time, 0.5)


def test_what_is_down_and_wanted(local, shown):
    def told(keys, frame=None):
        record = tick(local, keys, frame)
        shown.look(record)
        return shown.told(record)

    assert told(None) == {"down": None, "wanted": None}
    assert told(pressed(local.time)) == {"down": [], "wanted": None}
    assert told(pressed(local.time, 39), 0) == {"down": [39], "wanted": [39]}
    assert told(pressed(local.time, 50), 1) == {"down": [39, 50], "wanted": [39, 43]}
    for _ in range(4):
        last = told(pressed(local.time, 50), 1)
    assert last == {"down": [39, 50], "wanted": [39, 43]}, "a stroke is shown for 0.1 s"
    assert told(pressed(local.time, 50), 1) == {"down": [50], "wanted": [39, 43]}
    heard = pressed(local.time, 50)
    local.time += 0.5
    assert told(heard) == {"down": None, "wanted": None}, "too old"


def test_a_session_without_a_piano_shows_none(local):
    shown = ShownKeys(SessionHeader("three", ("a",), 0.005, 0, {}))
    record = tick(local, None)
    shown.look(record)
    assert shown.told(record) is None


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
