"""What holds of an emulated motor whatever is sent to it, and whatever happens to it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from motor_rig import ID, Motor

from humanoid_sim.hardware.emulation import firmware
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.fields import MotorMode

_COMMANDS = st.one_of(
    st.just(messages.Enable(ID)),
    st.builds(messages.Stop, st.just(ID), st.booleans()),
    st.builds(
        messages.OperationControl,
        st.just(ID),
        st.floats(-13.0, 13.0),
        st.floats(-44.0, 44.0),
        st.floats(-17.0, 17.0),
        st.floats(0.0, 500.0),
        st.floats(0.0, 5.0),
    ),
    st.just(messages.GetDeviceId(ID)),
    st.just(messages.SetZero(ID)),
    st.just(messages.SaveParameters(ID)),
    st.builds(messages.SetActiveReport, st.just(ID), st.booleans()),
    st.builds(messages.ReadParameter, st.just(ID), st.integers(0x7000, 0x7030)),
    st.builds(
        messages.WriteParameter,
        st.just(ID),
        st.sampled_from([0x7005, 0x700B, 0x7026, 0x7028]),
        st.binary(min_size=4, max_size=4),
    ),
)
_FEELINGS = st.fixed_dictionaries(
    {},
    optional={
        "shaft": st.floats(-30.0, 30.0),
        "temperature": st.floats(0.0, 200.0),
        "voltage": st.floats(0.0, 70.0),
        "encoder_fault": st.booleans(),
        "overcurrent": st.booleans(),
    },
)
_EVENTS = st.lists(st.one_of(_COMMANDS, _FEELINGS, st.floats(0.001, 0.05)), max_size=20)


@given(_EVENTS)
def test_only_an_enable_enables_a_faulty_motor_never_runs_and_only_a_running_one_has_a_target(events):
    motor = Motor()
    for event in events:
        was_running = motor.state.is_running
        if isinstance(event, dict):
            motor.feel(**event)
            motor.wait(0.001)
        elif isinstance(event, float):
            motor.wait(event)
        else:
            motor.tell(event)
        state = motor.state
        if state.is_running and not was_running:
            assert isinstance(event, messages.Enable)
        assert state.mode in (MotorMode.RESET, MotorMode.RUN)
        assert not (state.is_running and (state.status_faults or state.faults))
        assert state.command is None or state.is_running
        assert 0.0 <= motor.mit().temperature <= 200.1


@given(_EVENTS, st.integers(1, 1000))
def test_silence_for_longer_than_the_can_timeout_always_ends_in_reset_mode(events, ticks):
    motor = Motor()
    for event in events:
        if not isinstance(event, dict | float):
            motor.tell(event)
    motor.write("canTimeout", ticks)
    motor.tell(messages.Enable(ID))
    motor.mit(effort=1.0)
    motor.wait(50e-6 * ticks + 0.002)
    assert motor.state.mode is MotorMode.RESET
    assert motor.state.command is None


@given(st.floats(-1e3, 1e3), st.sampled_from([12.5, 4 * math.pi]))
def test_wrapping_keeps_the_angle_up_to_whole_ranges(position, limit):
    found = firmware.wrapped(position, limit)
    assert -limit <= found <= limit
    turns = (position - found) / (2 * limit)
    assert turns == pytest.approx(round(turns), abs=1e-9)
