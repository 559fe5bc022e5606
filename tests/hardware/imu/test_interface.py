import time

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.imu.interface import SimulatedImu, make_imu
from humanoid_sim.simulation.sensors import ImuSample


def test_port_baud_rate_and_mounting(device):
    imu = make_imu(f"microstrain:{device.port}@460800", "1,0,0,0", time.monotonic)
    imu.open()
    reading = imu.read(time.monotonic())
    imu.close()
    assert reading.linear_acceleration == pytest.approx([0.0, 0.0, -9.80665])  # mounted upside down, and level


@pytest.mark.parametrize("text", ["", "microstrain", "microstrain:", "xsens:/dev/ttyUSB0", "microstrain:/dev/x@fast"])
def test_an_imu_that_is_not_known(text):
    with pytest.raises(InputError, match=f"--imu: is '{text}', expected none, microstrain:PORT or "):
        make_imu(text, "0,1,0,0", time.monotonic)


@pytest.mark.parametrize("text", ["", "1,0,0", "1,1,0,0", "w,x,y,z", "nan,0,0,0"])
def test_a_mounting_that_is_no_rotation(text):
    with pytest.raises(InputError, match=f"--imu-mounting: is '{text}', expected w,x,y,z: a unit quaternion"):
        make_imu("microstrain:/dev/ttyACM0", text, time.monotonic)


def test_the_simulated_one_reads_its_plant():
    sample = ImuSample(np.array([0.0, 1.0, 0.0, 0.0]), np.ones(3), np.array([0.0, 0.0, -9.81]))
    imu = SimulatedImu(lambda: sample)
    imu.open()
    reading = imu.read(3.0)
    imu.close()
    assert reading.status.is_ok
    assert reading.quaternion.tolist() == [0.0, 1.0, 0.0, 0.0]
    assert reading.angular_velocity.tolist() == [1.0, 1.0, 1.0]
    assert reading.linear_acceleration.tolist() == [0.0, 0.0, -9.81]
