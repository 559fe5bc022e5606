"""A session in a network namespace of its own, and a client in another, at the other end of a cable."""

import shutil
import sys
import tempfile
from pathlib import Path

import pytest
from machines import CABLE, ROOT, Machine, play, plug_in, read_until

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

CLIENT = """
import sys, time
import numpy as np
from humanoid_sim.dds_client import RobotClient
from humanoid_sim.messages import Mode
from humanoid_sim.mit import MITCommand

JOINT, TURN, PATIENCE = "left_wrist_yaw", 0.3, 120.0

def until(condition):
    end = time.monotonic() + PATIENCE
    while (found := condition()) is None or found is False:
        if time.monotonic() > end:
            sys.exit("it never came")
        time.sleep(0.005)
    return found

with RobotClient("lite", interface=sys.argv[1]) as robot:
    def mode():
        received = robot.control_mode()
        return received and received.mode

    first = until(lambda: robot.state(0.1))
    until(lambda: mode() is Mode.REMOTE)
    first = until(lambda: robot.state(0.1))
    joint = first.names.index(JOINT)
    target, ones = first.position.copy(), np.ones(len(first.names))
    target[joint] += TURN
    command = MITCommand(target, 0.0 * ones, 0.0 * ones, 40.0 * ones, 2.0 * ones)

    def turned():
        robot.command(command)
        state = robot.state(0.01)
        return state and bool(abs(state.position[joint] - target[joint]) < 0.3 * TURN)

    until(turned)
    print("turned", flush=True)
    until(lambda: mode() is Mode.DAMPING)
    print("damped", flush=True)
"""


@pytest.fixture
def machines():
    """The robot's computer and another one, joined by a cable."""
    if shutil.which("unshare") is None or shutil.which("ip") is None:
        pytest.skip("needs unshare (util-linux) and ip (iproute2)")
    with tempfile.TemporaryDirectory(prefix="hs-") as name:  # pytest's own folders are too long for sockets
        folders = [Path(name, machine) for machine in ("robot", "host")]
        for folder in folders:
            folder.mkdir()
        try:
            with Machine(folders[0]):
                pass
        except OSError as error:
            pytest.skip(str(error))
        with Machine(folders[0]) as robot, Machine(folders[1], beside=robot) as host:
            plug_in(robot, host)
            yield robot, host


def test_a_client_on_another_machine_reads_the_robot_and_commands_it_until_it_is_silent(machines):
    robot, host = machines
    session = play(robot, "--dds", CABLE, script="damp; load_a; wait; start_remote; hold 600")
    client = host.python("-c", CLIENT, CABLE, cwd=ROOT)
    read_until(session, "remote commands arrive and are in force")
    read_until(client, "turned")
    read_until(session, "no remote command for 100 ms: the joints are damped")
    robot.run(sys.executable, "-m", "humanoid_sim.mode", "damp", cwd=ROOT)
    read_until(client, "damped")
    client.communicate(timeout=60.0)
    assert client.returncode == 0
