import pytest

from humanoid_sim.hardware.bus.address import parse_address
from humanoid_sim.hardware.bus.open_channels import ChannelLock

pytestmark = pytest.mark.usefixtures("lite_motors")


_CHANNEL = "virtual:bench-tools"
_QUICK = ("--wait", "0.03", "--first", "11", "--last", "27")


def test_every_motor_is_found_with_its_joint_and_firmware(run, table_rows):
    status, printed, _ = run("discover", _CHANNEL, *_QUICK, "--robot", "lite", "--firmware")
    assert status == 0
    found = {int(row[1]): row for row in table_rows(printed)}
    assert sorted(found) == [*range(11, 18), *range(21, 28)]
    assert found[14][3:] == ["0.0.3.255", "(rs-00)", "left_elbow_pitch"]
    assert len({row[2] for row in found.values()}) == 14
    assert all(len(bytes.fromhex(row[2])) == 8 for row in found.values())
    status, printed, _ = run("discover", _CHANNEL, "--first", "13", "--last", "14", "--wait", "0.1")
    assert status == 0
    assert [row[1] for row in table_rows(printed)] == ["13", "14"], "only the asked ids are asked"


def test_status_3_where_nothing_answers(run):
    status, printed, complained = run("discover", _CHANNEL, "--first", "40", "--last", "41", "--wait", "0.01")
    assert (status, printed) == (3, "")
    assert complained.splitlines() == [
        f"no motor answers on {_CHANNEL}: ids 40 to 41 were asked",
        "  check: a virtual channel exists inside one program only; two share udp_multicast:239.74.163.2 (python -m "
        "humanoid_sim.hardware emulate --channel udp_multicast:239.74.163.2)",
    ]


def test_status_1_where_a_joint_is_missing(run):
    words = ("--first", "11", "--last", "26", "--wait", "0.03", "--robot", "lite")
    status, _, complained = run("discover", _CHANNEL, *words)
    assert status == 1
    assert complained == f"missing: right_wrist_pitch (motor 27 on {_CHANNEL})\n"


def test_a_channel_in_use_is_refused(run):
    with ChannelLock(parse_address(_CHANNEL)):
        status, _, complained = run("discover", _CHANNEL, *_QUICK)
    assert status == 2
    assert complained.startswith(f"error: {_CHANNEL}: is in use by another session (")
