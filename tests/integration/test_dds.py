"""A session in a network namespace of its own, and a client in another, at the other end of a cable."""

import shutil
import tempfile
from pathlib import Path

import pytest
from machines import CABLE, ROOT, Machine, play, plug_in, read_until

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

CLIENT = """
import functools, runpy, sys
from humanoid_sim import dds_client
dds_client.RobotClient = functools.partial(dds_client.RobotClient, interface=sys.argv.pop(1))
runpy.run_path(sys.argv.pop(1), run_name="__main__")
"""
"""The example of a client, on another network interface."""


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
    client = host.python("-c", CLIENT, CABLE, str(ROOT / "examples" / "gravity_compensation.py"), cwd=ROOT)
    read_until(client, "REMOTE: holding")
    read_until(session, "remote commands arrive and are in force")
    client.kill()
    read_until(session, "no remote command for 100 ms: the joints are damped")
