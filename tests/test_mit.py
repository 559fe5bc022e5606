"""The joint surface: types that cannot be changed or malformed, and the MIT law."""

from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim import mit
from humanoid_sim.errors import FieldError
from humanoid_sim.testing import any_arrays, any_commands, any_numbers, any_states, valid_commands

STATE_ARRAYS = (
    "joint_position", "joint_velocity", "joint_effort", "joint_age",
    "imu_quaternion", "imu_angular_velocity", "imu_linear_acceleration",
)  # fmt: skip


def state_arrays(*batch, n=2):
    widths = dict.fromkeys(STATE_ARRAYS[:4], n) | {"imu_quaternion": 4}
    return {name: np.full((*batch, widths.get(name, 3)), 0.5) for name in STATE_ARRAYS}


def command_arrays(*batch, n=2):
    return {name: np.full((*batch, n), 0.5) for name in mit.COMMAND_FIELDS}


def test_field_order_is_frozen():
    assert tuple(f.name for f in fields(mit.MITState)) == ("time", *STATE_ARRAYS, "extern")
    assert [f.name for f in fields(mit.MITCommand)] == ["position", "velocity", "effort", "stiffness", "damping"]
    assert mit.COMMAND_FIELDS == ("position", "velocity", "effort", "stiffness", "damping")
    assert [f.name for f in fields(mit.Extern)] == ["value", "arrival_time", "timeout"]


MAKERS = {"MITState": (partial(mit.MITState, 0.0), state_arrays), "MITCommand": (mit.MITCommand, command_arrays)}


@pytest.mark.parametrize(
    ("kind", "name"),
    [*(("MITState", name) for name in STATE_ARRAYS), *(("MITCommand", name) for name in mit.COMMAND_FIELDS)],
)
def test_an_array_is_a_read_only_copy_and_one_that_is_wrong_is_named(kind, name):
    make, sound = MAKERS[kind]
    arrays = sound()
    made = make(**arrays)
    arrays[name][0] = 9.0
    assert getattr(made, name)[0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        getattr(made, name)[0] = 1.0
    # Every other array is measured by the positions.
    measured = {"joint_position": "joint_velocity", "position": "velocity"}.get(name, name)
    wrong = np.zeros((3, 7)) if kind == "MITState" else np.zeros(3)
    for value, problem in (
        (wrong, rf"{measured}: shape is \(.*\), expected \("),
        (["a", "b"], f"{name}: dtype is <U1, expected real numbers"),
    ):
        with pytest.raises(FieldError, match=rf"^{kind}\.{problem}"):
            make(**{**arrays, name: value})


@pytest.mark.parametrize("batch", [(), (5,), (2, 3), (0,)])
def test_batches(batch):
    state = mit.MITState(time=0.0, **state_arrays(*batch, n=7))
    command = mit.MITCommand(**command_arrays(*batch, n=7))
    assert state.joint_count == command.joint_count == 7
    assert state.imu_quaternion.shape == (*batch, 4)
    assert torque_of(state, command, 10.0).shape == (*batch, 7)


def test_unknown_state():
    state = mit.MITState.unknown(3, time=2.0)
    assert state.time == 2.0
    assert np.isnan(state.joint_position).all()
    assert state.joint_age.tolist() == [np.inf] * 3
    assert state.imu_quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert state.imu_linear_acceleration.tolist() == [0.0, 0.0, 9.81]
    assert dict(state.extern) == {}


@given(any_commands(3))
def test_is_finite(command):
    expected = all(abs(x) < np.inf for name in mit.COMMAND_FIELDS for x in getattr(command, name).tolist())
    assert command.is_finite() == expected


def torque_of(state, command, effort_limit):
    return mit.mit_torque(command, state.joint_position, state.joint_velocity, effort_limit)


def bits(array):
    """All bits but the sign of what is not a number: the sum of two such takes either's, as lanes fall."""
    return np.where(np.isnan(array), np.nan, array).tobytes()


def test_torque_literal():
    state = mit.MITState(time=0.0, **state_arrays() | {"joint_position": [0.5, -1.0], "joint_velocity": [2.0, 0.0]})
    command = mit.MITCommand([1.0, 0.0], [0.0, 3.0], [0.25, -0.5], [10.0, 20.0], [1.5, 2.0])
    # 10 (1 - 0.5) + 1.5 (0 - 2) + 0.25;  20 (0 + 1) + 2 (3 - 0) - 0.5
    assert torque_of(state, command, np.inf).tolist() == [2.25, 25.5]
    assert torque_of(state, command, [4.0, 4.0]).tolist() == [2.25, 4.0]
    assert torque_of(state, command, 1.0).tolist() == [1.0, 1.0]
    assert torque_of(state, replace(command, effort=[-99.0, 0.0]), 1.0).tolist() == [-1.0, 1.0]


@pytest.mark.parametrize(
    ("field", "torque"), [("position", 6.0), ("velocity", 5.0), ("effort", 1.0), ("stiffness", -4.0), ("damping", -3.0)]
)
def test_torque_depends_on_every_field(field, torque):
    """Each field alone raised by one, from q 4, qd 3 and otherwise K_p 6 or K_d 5 at zero error."""
    state = mit.MITState(time=0.0, **state_arrays(n=1) | {"joint_position": [4.0], "joint_velocity": [3.0]})
    at_rest = {"position": 4.0, "velocity": 3.0, "effort": 0.0, "stiffness": 6.0, "damping": 5.0}
    if field in ("stiffness", "damping"):
        at_rest |= {"position": 0.0, "velocity": 0.0, "stiffness": 0.0, "damping": 0.0}
    at_rest[field] += 1.0
    command = mit.MITCommand(*([value] for value in at_rest.values()))
    assert torque_of(state, command, np.inf).tolist() == [torque]


@given(any_states(3, 0.0), valid_commands(3), st.floats(1e-6, 1e3))
def test_torque_stays_within_the_limit(state, command, limit):
    with np.errstate(all="ignore"):
        torque = torque_of(state, command, limit)
    known = np.isfinite(state.joint_position) & np.isfinite(state.joint_velocity)
    assert (np.abs(torque[known]) <= limit).all()
    assert not np.isnan(torque[known & (np.abs(state.joint_position) < 1e300)]).any()


def test_torque_broadcasts_one_command_over_a_batch():
    state = mit.MITState(time=0.0, **state_arrays(4, n=2))
    command = mit.MITCommand(*[np.ones(2)] * 5)
    single = torque_of(mit.MITState(time=0.0, **state_arrays(n=2)), command, [3.0, 0.5])
    batch = torque_of(state, command, [3.0, 0.5])
    assert single.tolist() == [2.0, 0.5]
    assert batch.tolist() == [[2.0, 0.5]] * 4


@given(st.data())
def test_torque_of_a_batch_is_that_of_its_robots_bit_for_bit(data):
    states = data.draw(st.lists(any_states(3, 0.0), min_size=1, max_size=3))
    commands = [data.draw(any_commands(3)) for _ in states]
    batch_state = mit.MITState(0.0, *(np.stack([getattr(s, name) for s in states]) for name in STATE_ARRAYS))
    batch_command = mit.MITCommand(*(np.stack([getattr(c, name) for c in commands]) for name in mit.COMMAND_FIELDS))
    with np.errstate(all="ignore"):
        batch = torque_of(batch_state, batch_command, [1.0, np.inf, 5.0])
        single = [torque_of(s, c, [1.0, np.inf, 5.0]) for s, c in zip(states, commands, strict=True)]
    assert bits(batch) == bits(np.stack(single))


def test_the_affine_form_is_the_same_law():
    generator = np.random.default_rng(0)
    command = mit.MITCommand(*generator.normal(size=(5, 4, 3)))
    position, velocity = generator.normal(size=(2, 4, 3))
    bias, ctrl = mit.affine_law(command)
    assert bias.shape == (4, 3, 2)
    assert bias[..., 0].tolist() == (-command.stiffness).tolist()
    assert bias[..., 1].tolist() == (-command.damping).tolist()
    for limit in (np.full(3, np.inf), np.array([0.1, 1.0, 2.0])):
        torque = mit.affine_torque(bias, ctrl, position, velocity, limit)
        np.testing.assert_allclose(torque, mit.mit_torque(command, position, velocity, limit), rtol=0, atol=1e-12)
        assert (np.abs(torque) <= limit).all()


def one_joint(position, velocity=0.0, effort=0.0, stiffness=50.0, damping=2.0):
    return mit.MITCommand(*(np.reshape(value, 1) for value in (position, velocity, effort, stiffness, damping)))


def bounded(command, position, velocity=0.0, limit=10.0, lead=0.0):
    arrays = (np.array([value]) for value in (position, velocity, limit))
    return float(mit.bounded_position(command, *arrays, lead)[0])


def test_a_position_is_moved_so_that_the_spring_keeps_within_the_limit():
    far = one_joint([1.0])
    assert bounded(one_joint([0.19]), 0.0) == 0.19, "within the limit it is left alone"
    assert bounded(far, 0.0) == pytest.approx(0.2)
    assert bounded(one_joint([-1.0]), 0.3) == pytest.approx(0.1)
    assert bounded(one_joint([1.0], effort=4.0), 0.0) == pytest.approx(0.12), "feed-forward takes its share"
    assert bounded(far, 0.0, velocity=2.0) == pytest.approx(0.28), "and so does damping"
    on_its_way = bounded(one_joint([1.0], damping=0.0), 0.0, velocity=2.0, lead=0.04)
    assert on_its_way == pytest.approx(0.2 + 0.08), "it keeps room for its motion"
    assert bounded(one_joint([1.0], effort=10.0, velocity=5.0), 0.0) == pytest.approx(0.0)
    assert bounded(one_joint([0.0], effort=10.0, velocity=5.0), 0.0) == 0.0, "the spring is never turned round"
    assert bounded(far, float("nan")) == 1.0, "without a position there is no bound"
    assert bounded(one_joint([1.0], stiffness=0.0), 0.0) == 1.0, "nor without a spring"


small = st.floats(-20.0, 20.0)


@given(small, small, small, st.floats(0.0, 500.0), st.floats(0.0, 5.0), small, small, st.floats(0.5, 20.0))
def test_the_law_stays_within_the_limit_wherever_the_spring_can_do_it(
    position, velocity, effort, stiffness, damping, joint, joint_velocity, limit
):
    effort = float(np.clip(effort, -limit, limit))
    command = one_joint([position], velocity, effort, stiffness, damping)
    moved = bounded(command, joint, joint_velocity, limit)
    rest = damping * (velocity - joint_velocity) + effort
    before, after = stiffness * (position - joint), stiffness * (moved - joint)
    assert abs(after) <= abs(before) + 1e-6
    assert before * after >= -1e-6
    assert abs(after + rest) <= max(limit, abs(rest)) + 1e-6


@pytest.mark.parametrize(
    ("time", "arrival", "timeout", "alive"),
    [
        (10.0, 10.0, 0.5, True),
        (10.5, 10.0, 0.5, True),
        (10.501, 10.0, 0.5, False),
        (9.99, 10.0, 0.5, True),  # it arrived after the state was read
        (1e9, 10.0, np.inf, True),
        (np.nan, 10.0, 0.5, False),
        (10.0, np.nan, 0.5, False),
        (10.0, 10.0, np.nan, False),
        (np.inf, np.inf, np.inf, False),
        (10.0, 10.0, -1.0, False),
    ],
)
def test_extern_is_zero_when_too_old(time, arrival, timeout, alive):
    extern = mit.Extern([1.0, -2.0], arrival, timeout)
    assert extern.at(time).tolist() == ([1.0, -2.0] if alive else [0.0, 0.0])
    assert extern.at(np.array([time, time])).tolist() == ([[1.0, -2.0]] * 2 if alive else [[0.0, 0.0]] * 2)


@given(any_arrays(3), any_numbers(), any_numbers())
def test_extern_never_raises_and_never_invents(value, arrival, time):
    at = mit.Extern(value, arrival, 0.5).at(time)
    assert at.tobytes() in (value.tobytes(), np.zeros(3).tobytes())


def test_velocities_of_points_are_called_what_recordings_call_them():
    names = [mit.point_velocity(point) for point in (mit.BASE, mit.IMU, "head")]
    assert names == ["base_linear_velocity", "base_linear_velocity_at_imu", "base_linear_velocity_at_head"]
