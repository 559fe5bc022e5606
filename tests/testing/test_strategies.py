"""The strategies reach what they promise, for any number of joints, and nothing else."""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st

from humanoid_sim import testing
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.messages import Intent, SafetyLevel

SEARCH = settings(max_examples=2000, derandomize=True, database=None, phases=[Phase.generate], deadline=None)
FEW = settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow])
JOINTS_14 = tuple(f"joint_{i}" for i in range(14))


@pytest.mark.parametrize(
    ("strategy", "wanted"),
    [
        (testing.any_numbers(), np.isnan),
        (testing.any_numbers(), lambda x: 0.0 < abs(x) < 1e-307),
        (testing.any_arrays(14), lambda a: np.isinf(a).sum() == 1),
        (testing.any_arrays(14), lambda a: np.isnan(a).sum() > 2 and np.isfinite(a).any()),
        (testing.any_externs(), lambda e: not e),
        (testing.any_externs(), lambda e: "anchor_pose" in e and e["anchor_pose"].value.shape != (7,)),
        (testing.any_externs(("gyro_2",)), lambda e: "gyro_2" in e),
        (testing.any_states(14, 3.0), lambda s: np.isnan(s.joint_position).all()),
        (testing.any_states(14, 3.0), lambda s: np.isnan(s.joint_position).sum() == 1),
        (testing.any_states(14, 3.0), lambda s: not s.imu_quaternion.any()),
        (testing.safety_statuses(), lambda some: {s.level for s in some} == {SafetyLevel.OK, SafetyLevel.CRITICAL}),
        (testing.safety_statuses(), lambda some: any(s.flags >= 64 for s in some)),
        (testing.intents(), lambda some: len(some) == 3 and some[0] is not Intent.DAMP and Intent.DAMP in some),
        (testing.button_readings(8), all),
        (testing.button_readings(8), lambda down: sum(down) == 2),
        (testing.clock_jumps(), lambda t: t < -1e5),
        (testing.any_commands(14), lambda c: (c.stiffness < 0).any()),
        (testing.any_remote_commands(14, 3.0), lambda r: r.command.joint_count == 15),
        (
            testing.any_remote_commands(14, 3.0),
            lambda r: not command_problem(r.command, JOINTS_14) and r.arrival_time == 3.0,
        ),
        (testing.any_tick_inputs(14, 3.0), lambda t: t.safety and t.intents and t.remote is not None),
    ],
)
def test_what_must_be_drawn_sometimes(strategy, wanted):
    assert find(strategy, lambda value: bool(wanted(value)), settings=SEARCH) is not None


@FEW
@given(st.data(), st.sampled_from([1, 3, 14, 29]), st.floats(-10, 10))
def test_what_a_working_robot_or_sender_gives_is_sound(data, n, time):
    state = data.draw(testing.healthy_states(n, time))
    assert (state.joint_count, state.time) == (n, time)
    for array in (state.joint_position, state.joint_velocity, state.joint_effort):
        assert (np.abs(array) <= 3.0).all()
    assert not state.joint_age.any()
    command = data.draw(testing.valid_commands(n))
    assert command_problem(command, tuple(f"joint_{i}" for i in range(n))) == ""
