"""Modes, intents and safety bits are those of the wire, number for number."""

import pickle
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from humanoid_sim.errors import FieldError
from humanoid_sim.messages import (
    OK,
    ControlMode,
    Event,
    EventKind,
    FaultReport,
    Intent,
    Mode,
    PolicyStep,
    RemoteCommand,
    SafetyFlag,
    SafetyLevel,
    SafetyStatus,
    StandbyState,
    TickInput,
    TickOutput,
)
from humanoid_sim.mit import MITCommand, MITState


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Mode, {"ZERO_TORQUE": 0, "DAMPING": 1, "STANDBY": 2, "LOCOMOTION": 3, "REMOTE": 4}),
        (SafetyLevel, {"OK": 0, "WARNING": 1, "FAULT": 2, "CRITICAL": 3}),
        (
            SafetyFlag,
            {"BUS_OFF": 1, "RX_TIMEOUT": 2, "TX_QUEUE_OVERRUN": 4}
            | {"MOTOR_FAULT": 8, "TEMPERATURE_LIMIT": 16, "INVALID_FRAME": 32},
        ),
        (
            EventKind,
            {"NOTE": 0, "FRESH_START": 1, "SUPPORT": 2, "FAILURE": 3, "LOSS": 4, "ENDING": 5, "FALL": 6, "POLICY": 7},
        ),
        (
            Intent,
            {name.upper(): name for name in ("damp", "load_a", "load_b", "start_locomotion", "start_remote", "quit")},
        ),
    ],
)
def test_names_and_numbers(kind, values):
    assert {one.name: one.value for one in kind} == values


def test_no_flag_is_0():
    assert SafetyFlag.NONE.value == 0


def test_the_modes_in_which_no_support_holds_the_robot():
    assert [mode for mode in Mode if mode.is_free] == [Mode.LOCOMOTION, Mode.REMOTE]


@pytest.mark.parametrize(
    ("message", "names"),
    [
        (SafetyStatus, ["level", "flags", "source", "message"]),
        (ControlMode, ["mode", "controller_name", "status_message"]),
        (StandbyState, ["current_segment", "total_segments", "progress", "is_finished"]),
        (RemoteCommand, ["command", "arrival_time"]),
        (PolicyStep, ["frame", "observation", "action"]),
        (FaultReport, ["controller", "fallback", "message", "is_bug"]),
        (Event, ["time", "text", "kind", "header"]),
        (TickInput, ["state", "safety", "intents", "remote"]),
        (
            TickOutput,
            ["command", "control_mode", "standby", "quit", "faults", "refusals", "policy_step", "policy_error"],
        ),
    ],
)
def test_field_order(message, names):
    assert [f.name for f in fields(message)] == names


INSTANCES = [
    SafetyStatus(),
    ControlMode(Mode.STANDBY, "standby_controller_a"),
    StandbyState(0, 2, 0.5, False),
    RemoteCommand(MITCommand.zeros(2), 1.0),
    PolicyStep(0, np.zeros(3), np.zeros(2)),
    FaultReport("a", "b", "c"),
    Event(0.0, "released", EventKind.SUPPORT),
    TickInput(MITState.unknown(2)),
    TickOutput(MITCommand.zeros(2), ControlMode(Mode.ZERO_TORQUE, "zero_torque_controller")),
]


@pytest.mark.parametrize("instance", INSTANCES, ids=lambda instance: type(instance).__name__)
def test_frozen_and_picklable(instance):
    name = fields(instance)[0].name
    with pytest.raises(FrozenInstanceError):
        setattr(instance, name, getattr(instance, name))
    assert type(pickle.loads(pickle.dumps(instance))) is type(instance)


def test_arrays_inside_messages_stay_read_only_through_a_pickle():
    remote = pickle.loads(pickle.dumps(RemoteCommand(MITCommand.zeros(2), 1.0)))
    step = pickle.loads(pickle.dumps(PolicyStep(3, np.ones(3), np.ones(2))))
    assert not remote.command.damping.flags.writeable
    assert not step.observation.flags.writeable
    assert not step.action.flags.writeable
    assert step.frame == 3


def test_policy_step_is_a_read_only_float32_copy():
    observation, action = np.ones(3), np.ones(2)
    step = PolicyStep(0, observation, action)
    observation[0] = action[0] = 5.0
    assert step.observation.dtype == step.action.dtype == np.float32
    assert step.observation.tolist() == [1.0, 1.0, 1.0]
    assert step.action.tolist() == [1.0, 1.0]
    with pytest.raises(ValueError, match="read-only"):
        step.action[0] = 2.0


def test_defaults():
    assert OK.is_ok
    assert (OK.level, OK.flags, OK.source, OK.message) == (SafetyLevel.OK, SafetyFlag.NONE, "", "")
    tick = TickInput(MITState.unknown(1))
    assert (tick.safety, tick.intents, tick.remote) == ((), (), None)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_only_level_ok_is_ok(level):
    status = SafetyStatus(level)
    assert status.level is SafetyLevel(level)
    assert not status.is_ok
    assert SafetyStatus(0, SafetyFlag.MOTOR_FAULT).is_ok


@pytest.mark.parametrize("level", [-1, 4, None, "FAULT", 0.5])
def test_unknown_level_is_refused(level):
    with pytest.raises(FieldError, match=r"^SafetyStatus\.level: is .*, expected one of OK 0, WARNING 1, FAULT 2, CRI"):
        SafetyStatus(level)


@pytest.mark.parametrize("flags", [-1, 2**32, None, "BUS_OFF", 1.0])
def test_impossible_flags_are_refused(flags):
    with pytest.raises(FieldError, match=r"^SafetyStatus\.flags: is .*, expected an unsigned 32-bit mask"):
        SafetyStatus(2, flags)


def test_unnamed_flags_survive():
    assert SafetyStatus(2, 0x80000001).flags.value == 0x80000001
