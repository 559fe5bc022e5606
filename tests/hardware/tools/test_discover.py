import can

from humanoid_sim.hardware.can_bus import lock_channel, parse_address
from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot

CHANNEL = "virtual:bench-tools"


def test_every_motor_is_found_with_its_joint_and_firmware(run, table_rows, lite_motors):
    status, printed, _ = run("discover", CHANNEL, "--robot", "lite")
    assert status == 0
    found = {int(row[1]): row for row in table_rows(printed)}
    assert sorted(found) == [*range(11, 18), *range(21, 28)]
    assert found[14][3:] == ["left_elbow_pitch"]
    assert len({row[2] for row in found.values()}) == 14


def test_status_1_where_a_joint_is_missing(run, inject):
    channel = "virtual:bench-missing"
    with MockServer(load_robot("lite"), [channel]) as motors:
        inject(motors, Fault("silent", ("right_wrist_pitch",)))
        status, _, complained = run("discover", channel, "--robot", "lite")
    assert (status, complained) == (1, f"missing: right_wrist_pitch (motor 27 on {channel})\n")


def test_status_3_where_nothing_answers_with_what_was_received_instead(run):
    """Frames with 11-bit identifiers: motors in another protocol, or another program."""
    with can.Bus(interface="virtual", channel="nobody") as other:
        chatter = other.send_periodic(can.Message(arbitration_id=0x12, data=bytes(8), is_extended_id=False), 0.002)
        status, printed, complained = run("discover", "virtual:nobody")
        chatter.stop()
    assert (status, printed) == (3, "")
    assert "no motor answers on virtual:nobody" in complained
    assert "11-bit" in complained


def test_a_channel_in_use_is_refused(run):
    with lock_channel(parse_address(CHANNEL)):
        status, _, complained = run("discover", CHANNEL)
    assert status == 2
    assert f"{CHANNEL}: is in use by another session" in complained
