"""The motors' limits, against the table that they were taken from."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS

TABLE = Path(__file__).parents[3] / "shared" / "data" / "actuators.json"


def test_limits_of_small_and_large_motors() -> None:
    for model in ("rs-00", "rs-01", "rs-02", "rs-05"):
        assert (MOTORS[model].stiffness, MOTORS[model].damping) == (500.0, 5.0)
    for model in ("rs-03", "rs-04", "rs-06"):
        assert (MOTORS[model].stiffness, MOTORS[model].damping) == (5000.0, 100.0)
    assert MOTORS["rs-02"].damping_step == pytest.approx(7.6e-5, rel=0.01)


@pytest.mark.skipif(not TABLE.is_file(), reason="the table of actuators is not beside the checkout")
def test_limits_are_the_tables() -> None:
    models = json.loads(TABLE.read_text(encoding="utf-8"))["models"]
    assert {model["model"] for model in models} == set(MOTORS)
    for model in models:
        limits, motor = model["mit_limits"], MOTORS[model["model"]]
        assert (motor.stiffness, motor.damping) == (limits["kp"], limits["kd"])
        assert (motor.velocity, motor.effort) == (limits["velocity"], limits["torque"])


def test_the_shipped_robots_motors_are_known() -> None:
    for name in ("lite", "lite_neck"):
        motors = [joint.motor for joint in load_robot(name).joints if joint.motor is not None]
        assert motors
        assert {motor.model for motor in motors} <= set(MOTORS)
