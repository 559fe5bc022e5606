import pytest

from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.plan import control_rate
from humanoid_sim.play.refusals import options_without_effect
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.robots.description import load_robot


@pytest.mark.parametrize(
    ("asked", "policy_dt", "hertz", "moves"),
    [
        (None, 0.02, 200.0, False),
        (None, None, 200.0, False),
        (50.0, 0.02, 50.0, False),
        (99.9, 0.02, 100.0, True),
        (260.0, 0.02, 250.0, True),
        (10.0, 0.02, 50.0, True),  # never slower than the policy
        (None, 1 / 60, 180.0, True),
        (200.0, None, 200.0, False),
    ],
)
def test_the_control_rate_moves_to_a_multiple_of_the_policys(asked, policy_dt, hertz, moves):
    timestep = None if hertz != 180.0 else 1 / 1800
    period, notice = control_rate(
        PlayConfig(control_frequency=asked, physics_timestep=timestep), load_robot("lite"), policy_dt
    )
    assert period == pytest.approx(1.0 / hertz)
    assert bool(notice) == moves
    if moves:
        assert f"to {hertz:g} Hz" in notice


def test_options_that_change_nothing_are_named():
    lite = load_robot("lite")
    config = PlayConfig(command="1,0,0", drop=0.1, dry_run=True)
    assert options_without_effect(config, placeholder_checkpoint(lite).contract, lite) == (
        "without effect in simulation: --dry-run",
        "without effect for a policy that observes no velocity command: --command",
        "without effect for a base that does not move freely: --drop",
    )
    hardware = PlayConfig(hardware="can0", motion="wave", drop=0.1)
    assert options_without_effect(hardware, None, lite) == (
        "without effect on hardware: --drop",
        "without effect without a policy: --motion",
    )
    assert options_without_effect(PlayConfig(), placeholder_checkpoint(lite).contract, lite) == ()
