"""`play` on emulated motors; the quick robot and the way to run are those of the tests of `play`."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

# importlib mode leaves sys.path alone.
sys.path += [
    str(Path(__file__).parents[2] / name)
    for name in ("play", "policy", "hardware/imu", "hardware/play", "frontends/dds")
]

import pytest
from play_fixtures import folder, make_robot, quick, run

from humanoid_sim.hardware.calibration import CalibrationEntry, save_calibration
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.play import hardware_robot
from humanoid_sim.robots.description import load_robot

__all__ = ["folder", "make_robot", "quick", "run"]


@pytest.fixture
def calibrate(folder: Path) -> Callable[..., None]:
    """Write a calibration of the Lite; by default it says that all motors' zeros are the joints'."""

    def write(offset: Callable[[], float] = float, name: str = "calibration.yaml") -> None:
        motors = {joint.name: joint.motor for joint in load_robot("lite").joints if joint.motor is not None}
        entries = {joint: CalibrationEntry(motor.can_id, motor.direction, offset()) for joint, motor in motors.items()}
        save_calibration(folder / name, entries)

    return write


@pytest.fixture
def emulate(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[VirtualMotors]]:
    """Let `play` emulate motors with these options too; the motors that it makes."""

    def replace(**more: Any) -> list[VirtualMotors]:
        made: list[VirtualMotors] = []

        def make(*arguments: Any, **options: Any) -> VirtualMotors:
            made.append(VirtualMotors(*arguments, **{**options, **more}))
            return made[-1]

        monkeypatch.setattr(hardware_robot, "VirtualMotors", make)
        return made

    return replace
