"""Modes, intents and safety bits are those of the wire, number for number."""

import pickle
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from humanoid_sim import messages
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import MITCommand, MITState


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (messages.Mode, {"ZERO_TORQUE": 0, "DAMPING": 1, "STANDBY": 2, "LOCOMOTION": 3, "REMOTE": 4}),
        (messages.SafetyLevel, {"OK": 0, "WARNING": 1, "FAULT": 2, "CRITICAL": 3}),
        (
            messages.SafetyFlag,
            {
                **{"BUS_OFF": 1, "RX_TIMEOUT": 2, "TX_QUEUE_OVERRUN": 4, "MOTOR_FAULT": 8},
                **{"TEMPERATURE_LIMIT": 16, "INVALID_FRAME": 32},
            },
        ),
        (
            messages.EventKind,
            {
                **{"NOTE": 0, "FRESH_START": 1, "SUPPORT": 2, "FAILURE": 3, "LOSS": 4, "ENDING": 5, "FALL": 6},
                **{"POLICY": 7, "PUSH": 8},
            },
        ),
        (
            messages.Intent,
            {name.upper(): name for name in ("damp", "load_a", "load_b", "start_locomotion", "start_remote", "quit")},
        ),
    ],
)
def test_names_and_numbers(kind, values):
    assert {one.name: one.value for one in kind} == values
    assert messages.SafetyFlag.NONE.value == 0


def test_the_modes_in_which_no_support_holds_the_robot():
    assert [mode for mode in messages.Mode if mode.is_free] == [messages.Mode.LOCOMOTION, messages.Mode.REMOTE]


@pytest.mark.parametrize(
    ("message", "names"),
    [
        (messages.SafetyStatus, ["level", "flags", "source", "message"]),
        (messages.ControlMode, ["mode", "controller_name", "status_message"]),
        (messages.StandbyState, ["current_segment", "total_segments", "progress", "is_finished"]),
        (messages.RemoteCommand, ["command", "arrival_time"]),
        (messages.PolicyStep, ["frame", "observation", "action"]),
        (messages.FaultReport, ["controller", "fallback", "message", "is_bug"]),
        (messages.Event, ["time", "text", "kind", "header"]),
        (messages.TickInput, ["state", "safety", "intents", "remote"]),
        (
            messages.TickOutput,
            ["command", "control_mode", "standby", "quit", "faults", "refusals", "policy_step", "policy_error"],
        ),
    ],
)
def test_field_order(message, names):
    assert [f.name for f in fields(message)] == names


INSTANCES = [
    messages.SafetyStatus(),
    messages.ControlMode(messages.Mode.STANDBY, "standby_controller_a"),
    messages.StandbyState(0, 2, 0.5, False),
    messages.RemoteCommand(MITCommand.zeros(2), 1.0),
    messages.PolicyStep(0, np.zeros(3), np.zeros(2)),
    messages.FaultReport("a", "b", "c"),
    messages.Event(0.0, "released", messages.EventKind.SUPPORT),
    messages.TickInput(MITState.unknown(2)),
    messages.TickOutput(MITCommand.zeros(2), messages.ControlMode(messages.Mode.ZERO_TORQUE, "zero_torque_controller")),
]


@pytest.mark.parametrize("instance", INSTANCES, ids=lambda instance: type(instance).__name__)
def test_frozen_and_picklable(instance):
    name = fields(instance)[0].name
    with pytest.raises(FrozenInstanceError):
        setattr(instance, name, getattr(instance, name))
    assert type(pickle.loads(pickle.dumps(instance))) is type(instance)


def test_arrays_are_read_only_copies_also_through_a_pickle():
    remote = pickle.loads(pickle.dumps(messages.RemoteCommand(MITCommand.zeros(2), 1.0)))
    assert not remote.command.damping.flags.writeable
    observation, action = np.ones(3), np.ones(2)
    step = messages.PolicyStep(3, observation, action)
    observation[0] = action[0] = 5.0
    for one in (step, pickle.loads(pickle.dumps(step))):
        assert (one.frame, one.observation.tolist(), one.action.tolist()) == (3, [1.0, 1.0, 1.0], [1.0, 1.0])
        assert one.observation.dtype == one.action.dtype == np.float32
        assert not one.observation.flags.writeable
        assert not one.action.flags.writeable


def test_defaults():
    assert messages.OK.is_ok
    assert messages.SafetyStatus(messages.SafetyLevel.OK, messages.SafetyFlag.NONE, "", "") == messages.OK
    tick = messages.TickInput(MITState.unknown(1))
    assert (tick.safety, tick.intents, tick.remote) == ((), (), None)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_only_level_ok_is_ok(level):
    status = messages.SafetyStatus(level)
    assert status.level is messages.SafetyLevel(level)
    assert not status.is_ok
    assert messages.SafetyStatus(0, messages.SafetyFlag.MOTOR_FAULT).is_ok


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        *(
            ((level,), "level: is .*, expected one of OK 0, WARNING 1, FAULT 2, CRI")
            for level in (-1, 4, None, "F", 0.5)
        ),
        *(((2, flags), "flags: is .*, expected an unsigned 32-bit") for flags in (-1, 2**32, None, "BUS_OFF", 1.0)),
    ],
)
def test_what_cannot_be_on_the_wire_is_refused(values, problem):
    with pytest.raises(FieldError, match=rf"^SafetyStatus\.{problem}"):
        messages.SafetyStatus(*values)
    assert messages.SafetyStatus(2, 0x80000001).flags.value == 0x80000001, "a flag without a name survives"
