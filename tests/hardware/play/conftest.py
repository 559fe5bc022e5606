"""`play` on emulated motors; the quick robot and the way to run are those of the tests of `play`."""

from functools import partial

import pytest
from play_fixtures import folder, make_robot, quick, run

from humanoid_sim.hardware.calibration import CalibrationEntry, save_calibration
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.play import hardware_robot
from humanoid_sim.robots.description import load_robot

__all__ = ["folder", "make_robot", "quick", "run"]


@pytest.fixture
def calibrate(folder):
    """Write a calibration of the Lite; by default it says that all motors' zeros are the joints'."""

    def write(offset=0.0):
        motors = {joint.name: joint.motor for joint in load_robot("lite").joints}
        entries = {joint: CalibrationEntry(motor.can_id, motor.direction, offset) for joint, motor in motors.items()}
        save_calibration(folder / "calibration.yaml", entries)

    return write


@pytest.fixture
def told(monkeypatch):
    """What the mock motors log that `play` makes."""
    lines = []
    server = partial(MockServer, log=lambda _, text: lines.append(text))
    monkeypatch.setattr(hardware_robot, "MockServer", server)
    return lines
