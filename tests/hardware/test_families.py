from __future__ import annotations

from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.robots.motors import FAMILIES, MOTORS


def test_every_family_has_a_driver_and_models() -> None:
    assert set(DRIVERS) <= set(FAMILIES) == {model.family for model in MOTORS.values()}
