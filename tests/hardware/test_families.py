from __future__ import annotations

import dataclasses
from types import MappingProxyType

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.hardware import families
from humanoid_sim.hardware.adapter.robot import HardwareRobot
from humanoid_sim.hardware.families import ADAPTERS, adapter_of
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS


def test_every_models_family_has_an_adapter() -> None:
    assert set(ADAPTERS) <= {model.family for model in MOTORS.values()}
    assert adapter_of(load_robot("lite")) is HardwareRobot


def test_motors_of_several_families_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    other = dataclasses.replace(MOTORS["rs-05"], family="other")
    monkeypatch.setattr(families, "MOTORS", MappingProxyType({**MOTORS, "rs-05": other}))
    with pytest.raises(InputError, match=r"^lite: has motors of other and robstride, expected one family$"):
        adapter_of(load_robot("lite"))
