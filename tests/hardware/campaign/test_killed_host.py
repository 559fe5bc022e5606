"""A host that is killed in any mode, with the motors in another process: their CAN timeout is all that is left."""

import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from campaign_rig import emulated
from drive_rig import CAN_TIMEOUT, PERIOD

from humanoid_sim.hardware.bus.address import open_bus, parse_address
from humanoid_sim.messages import Mode

pytestmark = pytest.mark.soak

_HOST = Path(__file__).parent / "campaign_host.py"
_SLACK = 0.05
"""s for the last command to be on its way, and for this process to note what it is told."""
_COMMAND = 1
"""Kind of frame, in the uppermost bits of its identifier."""


@contextmanager
def driven_elsewhere(channel, mode):
    """A program that has driven the motors of a channel into a mode; begun again where the machine was too late."""
    for _ in range(4):
        with subprocess.Popen([sys.executable, str(_HOST), channel, mode.name], stdout=subprocess.PIPE) as host:
            if host.stdout.readline() == b"there\n":
                yield host
                return
    pytest.fail("the machine is too busy: four programs did not get their robot into the mode", pytrace=False)


def commands(bus):
    """Take what came on a bus; return the kernel's stamps of the commands among it, in s, wall clock."""
    frames = list(iter(lambda: bus.recv(0.0), None))
    return [frame.timestamp for frame in frames if frame.arbitration_id >> 24 == _COMMAND]


@pytest.mark.parametrize("mode", tuple(Mode), ids=lambda mode: mode.name)
def test_the_motors_stop_by_themselves_and_stay_so(mode, table):
    channel = f"udp_multicast:239.74.164.{10 + mode}"
    with emulated(channel) as (motors, diary):
        with driven_elsewhere(channel, mode) as host, open_bus(parse_address(channel)) as bus:
            time.sleep(3 * PERIOD)
            assert len(diary.times_of("enabled", 0.0)) % 14 == 0
            before = np.abs(motors.truth.joint_effort).max()
            heard = commands(bus)  # in time: the socket has room for four ticks
            host.kill()
            killed = time.monotonic()
            host.wait()
            heard += commands(bus)
        last = max(heard) + time.monotonic() - time.time()  # the host may have stood still before it was killed
        time.sleep(CAN_TIMEOUT + 0.3)
        stopped = [when - last for when in diary.times_of(": disabled", last)]
        assert len(stopped) == 14
        assert CAN_TIMEOUT - PERIOD <= min(stopped) <= max(stopped) <= CAN_TIMEOUT + PERIOD + _SLACK
        after = np.abs(motors.truth.joint_effort).max()
        assert after == 0.0
        time.sleep(0.3)
        assert diary.times_of("enabled", killed) == []
    when = f"{1e3 * max(stopped):.0f}"
    table.append(("host killed", mode.name, "nobody is left", when, when, f"{before:.1f} → {after:.1f}", "1"))
