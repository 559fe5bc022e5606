import time

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.imu.interface import make_imu


def test_port_baud_rate_and_mounting(device):
    imu = make_imu(f"microstrain:{device.port}@460800", "1,0,0,0", time.monotonic)
    imu.open()
    reading = imu.read(time.monotonic())
    imu.close()
    assert reading.linear_acceleration == pytest.approx([0.0, 0.0, -9.80665])  # mounted upside down, and level


@pytest.mark.parametrize("text", ["", "1,0,0", "1,1,0,0", "w,x,y,z", "nan,0,0,0"])
def test_a_mounting_that_is_no_rotation(text):
    with pytest.raises(InputError, match=f"--imu-mounting: is '{text}', expected w,x,y,z: a unit quaternion"):
        make_imu("microstrain:/dev/ttyACM0", text, time.monotonic)
