from types import SimpleNamespace

import pytest

from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.plan import control_rate


@pytest.mark.parametrize(
    ("own", "policy_dt", "hertz", "moves"),
    [
        (200.0, 0.02, 200.0, False),
        (200.0, None, 200.0, False),
        (50.0, 0.02, 50.0, False),
        (99.9, 0.02, 100.0, True),
        (260.0, 0.02, 250.0, True),
        (10.0, 0.02, 50.0, True),  # never slower than the policy
    ],
)
def test_the_control_rate_moves_to_a_multiple_of_the_policys(own, policy_dt, hertz, moves):
    robot = SimpleNamespace(simulation=SimpleNamespace(control_frequency=own, physics_timestep=0.0005))
    period, notice = control_rate(PlayConfig(), robot, policy_dt)
    assert period == pytest.approx(1.0 / hertz)
    assert bool(notice) == moves
    assert not moves or f"to {hertz:g} Hz" in notice
