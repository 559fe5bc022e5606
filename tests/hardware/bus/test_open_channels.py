import os
import subprocess
import sys
import time

import can
import pytest
from waiting import until

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus import open_channels
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.open_channels import ChannelLock, OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.joints import make_wiring
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.robots.description import load_robot


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(open_channels, "_SHARED", tmp_path)


CAN0 = BusAddress("socketcan", "can0")


def test_a_second_session_is_refused_and_told_by_whom():
    with (
        ChannelLock(CAN0),
        pytest.raises(RobotError, match=rf"can0: is in use by another session \(process {os.getpid()}, "),
    ):
        ChannelLock(CAN0)


def test_the_lock_of_a_killed_process_is_gone(tmp_path):
    script = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from humanoid_sim.hardware.bus import open_channels\n"
        "from humanoid_sim.hardware.bus.address import BusAddress\n"
        f"open_channels._SHARED = Path({str(tmp_path)!r})\n"
        "held = open_channels.ChannelLock(BusAddress('socketcan', 'can0'))\n"
        "print('held', flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(RobotError, match=f"process {process.pid}"):
            ChannelLock(CAN0)
        process.kill()
        process.wait()
    deadline = time.monotonic() + 30.0
    while True:
        try:
            ChannelLock(CAN0).release()
            break
        except RobotError:
            assert time.monotonic() < deadline
            time.sleep(0.01)


def test_a_link_in_the_place_of_the_lock_is_not_followed(tmp_path):
    with ChannelLock(CAN0):
        (path,) = tmp_path.iterdir()
    victim = tmp_path / "victim"
    victim.write_text("precious")
    path.unlink()
    path.symlink_to(victim)
    with pytest.raises(RobotError, match="cannot make its lock"):
        ChannelLock(CAN0)
    assert victim.read_text() == "precious"


def test_two_names_of_one_adapter_are_one_lock(tmp_path):
    (tmp_path / "ttyACM0").write_text("")
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyACM0")
    with (
        ChannelLock(BusAddress("slcan", str(tmp_path / "ttyACM0"))),
        pytest.raises(RobotError, match="is in use by another session"),
    ):
        ChannelLock(BusAddress("slcan", f"{tmp_path / 'by-id'}@115200"))


def test_motors_or_programs_that_speak_another_protocol_are_a_warning(address, peer):
    """LeRobot's motors speak MIT frames of 11 bits, which say nothing here."""
    checks = CheckList()
    line = OpenChannels([address], checks)
    try:
        link = RobstrideLink(line, make_wiring(load_robot("lite"), 1))
        line.listeners.append(link.receive)
        for motor_id in range(11, 18):
            data = bytes.fromhex("7fff7ff0000007ff")
            peer.send(can.Message(arbitration_id=motor_id, is_extended_id=False, data=data))
        until(lambda: line.channels[0].counters.received == 7)
        until(lambda: line.notes[0].strangers.total() == 7)
        line.warn_of_strangers(checks)
    finally:
        line.close()
    assert checks.problems == ()
    assert "7 × frame with an 11-bit identifier" in checks.warnings[0]
    assert all(slot.sample is None for slot in link.slots)
