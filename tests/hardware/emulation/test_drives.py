"""The MIT law on several motors."""

from __future__ import annotations

import numpy as np
from motor_rig import Motor, identity

from humanoid_sim.hardware.emulation.motors import Drives
from humanoid_sim.hardware.emulation.robstride_motor import RobstrideFirmware
from humanoid_sim.hardware.robstride.messages import Enable, OperationControl


def test_the_mit_law_and_its_limit() -> None:
    motors = [Motor(identity("rs-02")), Motor(identity("rs-05"))]
    firmwares = [RobstrideFirmware(motor.identity, motor.state.can_id) for motor in motors]
    drives = Drives([firmware.model for firmware in firmwares])
    motors[1].write("limit_torque", 4.0)
    for motor in motors:
        motor.status(Enable(motor.state.can_id))
    motors[0].status(OperationControl(motors[0].state.can_id, 1.0, 0.5, 0.25, 10.0, 2.0))
    motors[1].status(OperationControl(motors[1].state.can_id, 1.0, 0.0, 0.0, 50.0, 0.0))
    for i, motor in enumerate(motors):
        drives.follow(i, firmwares[i].drive(motor.state))
    for told, wanted in ((drives.position, (1.0, 1.0)), (drives.stiffness, (10.0, 50.0))):
        np.testing.assert_allclose(told, wanted, atol=0.01)  # as quantised by the frame
    drives.position[:], drives.velocity[:] = (1.0, 1.0), (0.5, 0.0)
    drives.effort[:], drives.stiffness[:], drives.damping[:] = (0.25, 0.0), (10.0, 50.0), (2.0, 0.0)
    torque = drives.torque(np.array([0.8, -0.5]), np.array([0.1, 3.0]))
    np.testing.assert_allclose(torque, [10.0 * 0.2 + 2.0 * 0.4 + 0.25, 4.0], rtol=1e-12)
    motors[0].cycle_power()
    drives.follow(0, firmwares[0].drive(motors[0].state))
    np.testing.assert_array_equal(drives.torque(np.array([0.8, 2.5]), np.zeros(2)), [0.0, -4.0])
