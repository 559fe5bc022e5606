from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.frontends.console import showing
from humanoid_sim.frontends.console.showing import ShownKeys
from humanoid_sim.messages import ControlMode, Mode, PolicyStep, SessionHeader
from humanoid_sim.mit import Extern


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
