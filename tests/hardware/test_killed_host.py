"""A host that is killed in any mode, with the motors in another process: their CAN timeout is all that is left."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from fault_rig import CAN_TIMEOUT, PERIOD, drives_of, lite

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.messages import Mode
from humanoid_sim.session.realtime import punctual_threads

pytestmark = pytest.mark.soak

_PROGRAM = Path(__file__).with_name("fault_rig.py")
_SLACK = 0.1
"""s that this machine may be late."""


@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
def test_the_motors_stop_by_themselves_and_stay_so(mode):
    channel, lines = f"udp_multicast:239.74.164.{10 + mode}", []
    with punctual_threads(behind=10):
        motors = MockServer(lite(), [channel], log=lambda _, text: lines.append((time.monotonic(), text)))
    with motors:
        with subprocess.Popen([sys.executable, str(_PROGRAM), channel, mode.name], stdout=subprocess.PIPE) as host:
            assert host.stdout.readline() == b"there\n"
            time.sleep(5 * PERIOD)
            host.kill()
            killed = time.monotonic()
            host.wait()
        time.sleep(CAN_TIMEOUT + 3 * _SLACK)
        stopped = [when - killed for when, text in lines if when > killed and text.endswith(": disabled")]
        assert len(stopped) == 14
        assert max(stopped) <= CAN_TIMEOUT + _SLACK
        assert not [text for when, text in lines if when < killed and text.endswith(": disabled")], (
            "they ran until then"
        )
        assert not [text for when, text in lines if when > killed and text.endswith(": enabled")]
        drives = []
        motors.call(lambda mock: drives.extend(drives_of(mock)))
        assert not any(drive.stiffness or drive.damping or drive.effort for drive in drives)
