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


def test_safety_flags():
    names = ("BUS_OFF", "RX_TIMEOUT", "TX_QUEUE_OVERRUN", "MOTOR_FAULT", "TEMPERATURE_LIMIT", "INVALID_FRAME")
    assert [(flag.name, flag.value) for flag in messages.SafetyFlag] == list(
        zip(names, (1, 2, 4, 8, 16, 32), strict=True)
    )
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


def test_arrays_inside_messages_stay_read_only_through_a_pickle():
    remote = pickle.loads(pickle.dumps(messages.RemoteCommand(MITCommand.zeros(2), 1.0)))
    step = pickle.loads(pickle.dumps(messages.PolicyStep(3, np.ones(3), np.ones(2))))
    assert not remote.command.damping.flags.writeable
    assert not step.observation.flags.writeable
    assert not step.action.flags.writeable
    assert step.frame == 3


def test_policy_step_is_a_read_only_float32_copy():
    observation, action = np.ones(3), np.ones(2)
    step = messages.PolicyStep(0, observation, action)
    observation[0] = action[0] = 5.0
    assert step.observation.dtype == step.action.dtype == np.float32
    assert step.observation.tolist() == [1.0, 1.0, 1.0]
    assert step.action.tolist() == [1.0, 1.0]
    with pytest.raises(ValueError, match="read-only"):
        step.action[0] = 2.0


def test_defaults():
    assert messages.OK.is_ok
    assert (messages.OK.level, messages.OK.flags, messages.OK.source, messages.OK.message) == (
        messages.SafetyLevel.OK,
        messages.SafetyFlag.NONE,
        "",
        "",
    )
    tick = messages.TickInput(MITState.unknown(1))
    assert (tick.safety, tick.intents, tick.remote) == ((), (), None)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_only_level_ok_is_ok(level):
    status = messages.SafetyStatus(level)
    assert status.level is messages.SafetyLevel(level)
    assert not status.is_ok
    assert messages.SafetyStatus(0, messages.SafetyFlag.MOTOR_FAULT).is_ok


@pytest.mark.parametrize("level", [-1, 4, None, "FAULT", 0.5])
def test_unknown_level_is_refused(level):
    with pytest.raises(FieldError, match=r"^SafetyStatus\.level: is .*, expected one of OK 0, WARNING 1, FAULT 2, CRI"):
        messages.SafetyStatus(level)


@pytest.mark.parametrize("flags", [-1, 2**32, None, "BUS_OFF", 1.0])
def test_impossible_flags_are_refused(flags):
    with pytest.raises(FieldError, match=r"^SafetyStatus\.flags: is .*, expected an unsigned 32-bit mask"):
        messages.SafetyStatus(2, flags)


def test_unnamed_flags_survive():
    assert messages.SafetyStatus(2, 0x80000001).flags.value == 0x80000001
