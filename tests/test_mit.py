"""The joint surface: types that cannot be changed or malformed, and the MIT law."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim import mit
from humanoid_sim.errors import FieldError
from humanoid_sim.testing.healthy import healthy_state
from humanoid_sim.testing.strategies import any_states, valid_commands


@pytest.mark.parametrize("sound", [healthy_state([0.5, 0.5]), mit.MITCommand.zeros(2)], ids=["state", "command"])
def test_arrays_are_read_only_float64_copies_of_one_shape(sound):
    names = [field.name for field in fields(sound) if field.name not in ("time", "extern")]
    assert len(names) >= 5
    for name in names:
        given = getattr(sound, name) + 0.5
        made = getattr(replace(sound, **{name: given}), name)
        assert made.tolist() == given.tolist()
        given[0] = 9.0
        assert made[0] != 9.0
        with pytest.raises(ValueError, match="read-only"):
            made[0] = 1.0
        assert getattr(replace(sound, **{name: [1] * len(given)}), name).dtype == np.float64
        with pytest.raises(FieldError, match=rf"^{type(sound).__name__}\.\w+: shape is"):
            replace(sound, **{name: np.zeros(7)})


def torque_of(state, command, effort_limit):
    return mit.mit_torque(command, state.joint_position, state.joint_velocity, effort_limit)


def test_torque_literal():
    state = replace(healthy_state([0.5, -1.0]), joint_velocity=[2.0, 0.0])
    command = mit.MITCommand([1.0, 0.0], [0.0, 3.0], [0.25, -0.5], [10.0, 20.0], [1.5, 2.0])
    # 10 (1 - 0.5) + 1.5 (0 - 2) + 0.25;  20 (0 + 1) + 2 (3 - 0) - 0.5
    assert torque_of(state, command, np.inf).tolist() == [2.25, 25.5]
    assert torque_of(state, command, [4.0, 4.0]).tolist() == [2.25, 4.0]
    assert torque_of(state, replace(command, effort=[-99.0, 0.0]), 1.0).tolist() == [-1.0, 1.0]


@given(any_states(3, 0.0), valid_commands(3), st.floats(1e-6, 1e3))
def test_torque_stays_within_the_limit(state, command, limit):
    with np.errstate(all="ignore"):
        torque = torque_of(state, command, limit)
    sane = (np.abs(state.joint_position) < 1e300) & (np.abs(state.joint_velocity) < 1e300)
    assert (np.abs(torque[sane]) <= limit).all()


def one_joint(position, velocity=0.0, effort=0.0, stiffness=50.0, damping=2.0):
    return mit.MITCommand([position], [velocity], [effort], [stiffness], [damping])


def bounded(command, position, velocity=0.0, limit=10.0, lead=0.0):
    arrays = (np.array([value]) for value in (position, velocity, limit))
    return float(mit.bounded_position(command, *arrays, lead)[0])


def test_a_position_is_moved_so_that_the_spring_keeps_within_the_limit():
    far = one_joint(1.0)
    assert bounded(one_joint(0.19), 0.0) == 0.19, "within the limit it is left alone"
    assert bounded(far, 0.0) == pytest.approx(0.2)
    assert bounded(one_joint(-1.0), 0.3) == pytest.approx(0.1)
    assert bounded(one_joint(1.0, effort=4.0), 0.0) == pytest.approx(0.12), "feed-forward takes its share"
    assert bounded(far, 0.0, velocity=2.0) == pytest.approx(0.28), "and so does damping"
    on_its_way = bounded(one_joint(1.0, damping=0.0), 0.0, velocity=2.0, lead=0.04)
    assert on_its_way == pytest.approx(0.2 + 0.08), "it keeps room for its motion"
    assert bounded(one_joint(0.0, effort=10.0, velocity=5.0), 0.0) == 0.0, "the spring never changes its sign"
    assert bounded(far, float("nan")) == 1.0, "without a position there is no bound"
    assert bounded(one_joint(1.0, stiffness=0.0), 0.0) == 1.0, "nor without a spring"


@pytest.mark.parametrize(
    ("time", "arrival", "timeout", "alive"),
    [
        (10.5, 10.0, 0.5, True),
        (10.501, 10.0, 0.5, False),
        (9.99, 10.0, 0.5, True),  # it arrived after the state was read
        (np.nan, 10.0, 0.5, False),
        (10.0, np.nan, 0.5, False),
        (np.inf, np.inf, np.inf, False),
    ],
)
def test_a_live_input_is_zero_when_too_old(time, arrival, timeout, alive):
    extern = mit.Extern([1.0, -2.0], arrival, timeout)
    assert extern.at(time).tolist() == ([1.0, -2.0] if alive else [0.0, 0.0])
    assert extern.at(np.array([time, time])).tolist() == ([[1.0, -2.0]] * 2 if alive else [[0.0, 0.0]] * 2)
