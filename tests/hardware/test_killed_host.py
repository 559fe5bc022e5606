"""`play` killed in any mode, with the motors in another process: their CAN timeout is all that is left."""

import subprocess
import sys
import time

import pytest
from waiting import until

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.messages import Mode
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads

pytestmark = pytest.mark.soak

CAN_TIMEOUT, SLACK = 0.1, 0.1  # s; this machine may be late
SCRIPTS = {
    Mode.ZERO_TORQUE: "hold 60",
    Mode.DAMPING: "damp; hold 60",
    Mode.STANDBY: "damp; load_a; hold 60",
    Mode.LOCOMOTION: "damp; load_a; wait; start_locomotion; hold 60",
    Mode.REMOTE: "damp; load_a; wait; hold 1; start_remote; hold 60",
}
OPTIONS = (
    *("--robot", "lite", "--policy", "lite_tracking", "--calibration", "none", "--allow-script", "--yes"),
    *("--no-gamepad", "--viewer", "none", "--record", "none", "--html", "none", "--remote", "gravity"),
)


@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
def test_the_motors_stop_by_themselves_and_stay_so(mode):
    channel, log = f"udp_multicast:239.74.164.{10 + mode}", []
    command = (*(sys.executable, "-u", "-m", "humanoid_sim.play"), *OPTIONS, "--script", SCRIPTS[mode])
    with punctual_threads(behind=10):
        motors = MockServer(load_robot("lite"), [channel], log=lambda _, text: log.append((time.monotonic(), text)))
    with motors:
        with subprocess.Popen([*command, "--hardware", channel], stdout=subprocess.PIPE, text=True) as host:
            assert any(
                ("real-time settings" if mode is Mode.ZERO_TORQUE else f" {mode.name} ") in line for line in host.stdout
            )
            until(lambda: len(log) == 14)
            time.sleep(0.1)
            host.kill()
            killed = time.monotonic()
        time.sleep(CAN_TIMEOUT + 3 * SLACK)
        changes = [(when - killed, text.split(": ")[1]) for when, text in log if when > killed]
        assert [change for _, change in changes] == ["disabled"] * 14, "and they ran until then"
        assert changes[-1][0] <= CAN_TIMEOUT + SLACK
        drives = []
        motors.call(lambda mock: drives.extend(motor.drive() for motor in mock.motors))
        assert not any(drive.stiffness or drive.damping or drive.effort for drive in drives)
