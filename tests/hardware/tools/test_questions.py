"""`hardware discover`, `ping` and `param` on the Lite's mock motors."""

import can
import pytest
from waiting import until

from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot

CHANNEL = "virtual:bench-questions"


@pytest.fixture(scope="module")
def log():
    return []


@pytest.fixture(scope="module", autouse=True)
def motors(log):
    with MockServer(load_robot("lite"), [CHANNEL], log=lambda _, text: log.append(text)) as motors:
        yield motors


@pytest.fixture
def values(run, table_rows):
    """Run `param`: its exit status, and the first word of each value by name."""

    def read(*words):
        status, printed, _ = run("param", CHANNEL, *words)
        return status, {row[1]: row[2] for row in table_rows(printed)}

    return read


def test_every_motor_is_found_with_its_joint(run, table_rows):
    status, printed, _ = run("discover", CHANNEL, "--robot", "lite")
    assert status == 0
    found = {int(row[1]): row for row in table_rows(printed)}
    assert sorted(found) == [*range(11, 18), *range(21, 28)]
    assert found[14][3:] == ["left_elbow_pitch"]
    assert len({row[2] for row in found.values()}) == 14


def test_a_motor_reports_the_firmware_that_it_was_given(run, motors):
    for version, text in (((0, 9, 3, 32), "0.9.3.32 (of no known model)"), ((0, 2, 3, 32), "0.2.3.32 (rs-02)")):
        motors.set_versions({"rs-02": version})
        assert text in run("ping", CHANNEL, "11")[1]


def test_a_motor_whose_frames_cannot_be_read_is_no_silent_one(run, motors, log):
    motors.inject(Fault("garbage", ("right_wrist_pitch",)))
    until(lambda: "fault: garbage of right_wrist_pitch" in log)
    status, _, complained = run("ping", CHANNEL, "27")
    motors.call(lambda mock: mock.clear_faults())
    assert (status, "motor 27 cannot be read: get device id with 7 bytes, expected 8" in complained) == (3, True)


def test_status_1_where_a_joint_is_missing(run, motors):
    motors.call(lambda mock: mock.set_power(13, False))
    status, _, complained = run("discover", CHANNEL, "--robot", "lite")
    motors.call(lambda mock: mock.set_power(13, True))
    assert (status, complained) == (1, f"missing: right_wrist_pitch (motor 27 on {CHANNEL})\n")


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (None, "its motors are those of one process"),
        (can.Message(arbitration_id=0x12, data=bytes(8), is_extended_id=False), "11-bit"),
        (can.Message(arbitration_id=0x12, data=bytes(16), is_fd=True), "CAN FD"),
        (can.Message(arbitration_id=0x1200AA02, data=bytes(8)), "another host sends 'write parameter' to motor 2"),
        (can.Message(arbitration_id=0x0000FD0B, data=bytes(8)), "an echo, as in loopback mode?"),
    ],
)
def test_status_3_where_nothing_answers_with_what_was_received_instead(run, message, words):
    with can.Bus(interface="virtual", channel="nobody", protocol=can.CanProtocol.CAN_FD) as other:
        chatter = None if message is None else other.send_periodic(message, 0.002)
        status, printed, complained = run("discover", "virtual:nobody")
        if chatter is not None:
            chatter.stop()
    assert (status, printed) == (3, "")
    assert "no motor answers on virtual:nobody" in complained
    assert words in complained


def test_another_host_is_told_beside_the_motors_that_it_may_drive(run):
    with can.Bus(interface="virtual", channel=CHANNEL.removeprefix("virtual:")) as other:
        chatter = other.send_periodic(can.Message(arbitration_id=0x1100AA01, data=bytes(8)), 0.002)
        status, _, complained = run("discover", CHANNEL)
        chatter.stop()
    assert (status, "command of another host" in complained) == (0, True)


def test_a_missing_motor_is_told_where_it_is_instead(run):
    status, _, complained = run("discover", f"virtual:nobody,{CHANNEL}", "--robot", "lite")
    assert (status, f"left_elbow_pitch (motor 14 on virtual:nobody; one is on {CHANNEL})" in complained) == (1, True)


def test_a_motor_says_who_and_how_it_is_without_being_enabled(run, motors, log):
    motors.inject(Fault("motor_fault", ("left_shoulder_yaw",), duration=0.01))
    until(lambda: any("left_shoulder_yaw: phase" in text for text in log))
    status, printed, complained = run("ping", CHANNEL, "13")
    lines = (line.split(maxsplit=1) for line in printed.splitlines() if line.startswith("  "))
    found = {words[0]: words[1] for words in lines}
    assert (status, complained) == (0, "")
    assert printed.startswith(f"motor 13 on {CHANNEL}, unique id ")
    assert (found["run_mode"], found["VBUS"], found["canTimeout"]) == ("0", "48 V", "0 (off)")
    assert (found["firmware"], found["faults"]) == ("0.0.3.255 (rs-00)", "phase_a_overcurrent")
    assert not any("enabled" in text for text in log)


def test_parameters_are_read_all_or_by_name_or_index(values):
    status, found = values("15")
    assert (status, len(found)) == (0, 17)
    assert (found["run_mode"], found["limit_torque"], found["canTimeout"]) == ("0", "5.5", "0")
    assert values("12", "vbus", "0x7026") == (0, {"VBUS": "48", "EPScan_time": "1"})


def test_a_value_is_written_verified_and_saved(values, motors):
    assert values("12", "canTimeout", "--value", "2000", "--save") == (0, {"canTimeout": "2000"})
    assert values("12", "limit_torque", "--value", "12.1") == (0, {"limit_torque": "12.1"})  # no float32 is 12.1

    def cycle_power(mock):
        mock.set_power(1, False)
        mock.set_power(1, True)

    motors.call(cycle_power)
    assert values("12", "canTimeout", "limit_torque") == (0, {"canTimeout": "2000", "limit_torque": "14"})
