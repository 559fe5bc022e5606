import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.hardware.robstride import parameters
from humanoid_sim.robots.motors import MOTORS

_WHOLE = [kind for kind in parameters.ParameterType if not kind.is_float]


@given(st.data())
def test_whole_numbers_survive(data):
    kind = data.draw(st.sampled_from(_WHOLE))
    bits, signed = int(kind.name[1:]), kind.name[0] == "I"
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    value = data.draw(st.integers(low, high))
    assert parameters.unpack_value(kind, parameters.pack_value(kind, value)) == value
    for beyond in (low - 1, high + 1):
        with pytest.raises(FieldError, match=f"expected a whole number of type {kind.name.lower()}"):
            parameters.pack_value(kind, beyond)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_floats_survive(value):
    kind = parameters.ParameterType.F32
    assert parameters.unpack_value(kind, parameters.pack_value(kind, value)) == value


def test_only_the_low_bytes_of_a_small_type_count():
    assert parameters.unpack_value(parameters.ParameterType.U8, b"\x05\xff\xff\xff") == 5
    assert math.isnan(parameters.unpack_value(parameters.ParameterType.F32, np.float32(math.nan).tobytes()))


def test_parameters_are_found_by_name_and_index_and_their_indices_are_unique():
    for name in ("canTimeout", "cantimeout", "0x7028", "28712"):
        assert parameters.find_parameter(name).index == 0x7028
    assert len(parameters.PARAMETERS) == len(parameters.PARAMETERS_BY_INDEX) == 29
    read_only = [p.name for p in parameters.PARAMETERS.values() if not p.is_writable]
    assert read_only == ["mechPos", "iqf", "mechVel", "VBUS"]


def test_defaults_and_the_fault_word_differ_by_model():
    for name, model, value in (
        ("limit_torque", "rs-04", 120.0),
        ("limit_cur", "rs-00", 16.0),
        ("canTimeout", "rs-00", 0),
        ("damper", "rs-00", 0),
        *(("limit_torque", model.name, model.peak_torque) for model in MOTORS.values()),
    ):
        assert parameters.default_value(parameters.PARAMETERS[name], model) == value
    assert [parameters.fault_word(model).index for model in ("rs-04", "rs-02")] == [0x3023, 0x3022]


def test_can_timeout_ticks_and_the_report_interval():
    # 0 would switch it off
    for seconds, ticks in ((0.1, 2000), (1.0, 20000), (0.0, 0), (1e-9, 1)):
        assert parameters.CanTimeout.to_ticks(seconds) == ticks
    assert parameters.CanTimeout.to_seconds(2000) == pytest.approx(0.1)
    for seconds in (-0.1, 5.1, math.nan):
        with pytest.raises(FieldError, match="expected 0 to 5 s"):
            parameters.CanTimeout.to_ticks(seconds)
    assert [parameters.report_interval(value) for value in (1, 3)] == pytest.approx([0.010, 0.020])


def test_every_model_accepts_its_own_defaults_and_its_limits():
    for name, motor in MOTORS.items():
        if motor.family != "robstride":
            continue
        for parameter in parameters.PARAMETERS.values():
            default = parameters.default_value(parameter, name)
            if default is not None:
                parameters.check_value(parameter, default, motor)
        for value in (0.0, motor.peak_torque):
            parameters.check_value(parameters.PARAMETERS["limit_torque"], value, motor)
        for value in (-0.01, 1.001 * motor.peak_torque):
            with pytest.raises(
                InputError, match=rf"^limit_torque: is .*, expected 0 to {motor.peak_torque:g} N·m for an {name}$"
            ):
                parameters.check_value(parameters.PARAMETERS["limit_torque"], value, motor)


def test_what_depends_on_the_model_is_the_limits_and_set_points():
    found = [name for name, parameter in parameters.PARAMETERS.items() if parameters.depends_on_model(parameter)]
    assert found == ["iq_ref", "spd_ref", "limit_torque", "limit_spd", "limit_cur"]
