from pathlib import Path
from types import SimpleNamespace

import models
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.play import policies
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.plan import control_rate
from humanoid_sim.play.policies import choose_policies
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")


def choose_policy(config, robot):
    return choose_policies(config, robot)[0].first


@pytest.mark.parametrize(
    ("policy", "robot", "followed"),
    [
        ("lite_tracking", "lite", "wave"),
        ("lite_piano", "lite_piano", "ode_to_joy"),
        ("lite_biped_velocity", "lite_biped", None),
    ],
)
def test_a_policy_that_ships_goes_by_its_name_and_follows_what_is_its_default(policy, robot, followed):
    choice = choose_policy(PlayConfig(policy=(policy,)), load_robot(robot))
    assert Path(choice.checkpoint.source).name == f"{policy}.onnx"
    assert (choice.motion_file and choice.motion_file.stem) == followed


def test_a_policy_of_the_users_needs_a_motion(tmp_path):
    contract = models.contract(
        task_type="tracking",
        body_names=("hand",),
        observation=("motion_body_pos_b", "joint_pos", "actions"),
    )
    path = models.saved(tmp_path / "p.onnx", models.linear_model(models.write_metadata(contract)))
    with pytest.raises(InputError, match=r"--motion: is missing; .* is a tracking policy"):
        choose_policy(PlayConfig(policy=(str(path),)), LITE)


def test_without_onnxruntime_zeros_stand_in_and_say_so(monkeypatch):
    monkeypatch.setattr(policies, "has_onnxruntime", lambda: False)
    choice = choose_policy(PlayConfig(), LITE)
    assert "lite_tracking.onnx does NOT run" in choice.warning
    assert choice.loaded.motion is not None
    width = choice.loaded.layout.width
    assert np.asarray(choice.loaded.policy(np.ones(width, dtype=np.float32), 3)).tolist() == [0.0] * 14


def test_on_hardware_no_policy_runs_that_nobody_named():
    for config in (PlayConfig(hardware="virtual:lite"), PlayConfig(policy=("none",))):
        assert choose_policy(config, LITE) is None


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
