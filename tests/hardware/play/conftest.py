"""`play` on emulated motors; the quick robot and the way to run are those of the tests of `play`."""

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
def emulate(monkeypatch):
    """Let `play` make mock motors with these faults and log; returns the motors that it makes."""

    def replace(faults=(), log=lambda *_: None):
        made = []

        def make(*arguments, **options):
            made.append(MockServer(*arguments, **options, log=log))
            for fault in faults:
                made[-1].inject(fault)
            return made[-1]

        monkeypatch.setattr(hardware_robot, "MockServer", make)
        return made

    return replace
