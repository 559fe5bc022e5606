"""What every tool refuses to do, and what it says of a motor that is silent."""

import io
import shlex

import pytest

_PLACES = {"NOBODY": "virtual:nobody", "SHARED": "udp_multicast:239.74.163.62"}
"""Nobody answers on the first; the second could be another process'."""


def _words(line):
    for name, address in _PLACES.items():
        line = line.replace(name, address)
    return shlex.split(line)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "bring-up virtual:a",
            "channels: 'virtual:a' is not a network interface; expected names such as can0 or can_left",
        ),
        ("bring-up 'can$0'", "channels: 'can$0' has characters that udev reads otherwise"),
        ("bring-up can_left --adapter can_left", "--adapter: is 'can_left', expected NAME=SERIAL or NAME=SERIAL/PORT"),
        (
            "bring-up can_left --adapter can_left=SERIAL/0",
            "--adapter: is 'can_left=SERIAL/0', where SERIAL stands for the adapter's serial number; plugged in: ",
        ),
        ("bring-up can_left --adapter 'can_left=1\", RUN+=\"x'", "--adapter: is "),
        ("bring-up can_left --adapter can_left=1/99", "--adapter: is 'can_left=1/99', expected"),
        ("bring-up can_left --adapter left=1", "--adapter: 'left=1' names no channel; the channels are can_left"),
        ("bring-up can_left --adapter can_left=1 --adapter can_left=2", "--adapter: can_left is given twice"),
        (
            "bring-up a,b --adapter a=1 --adapter b=1",
            "--adapter: a and b are one adapter and port; expected different ones",
        ),
        ("bring-up a,b --adapter a=1/0 --adapter b=1", "--adapter: a and b are one adapter and port"),
        ("bring-up can0 --adapter can0=1", "--adapter: can0 is a name that the kernel gives by itself"),
        ("bring-up can0 --bitrate 1000001", "--bitrate: is 1000001, expected 10000 to 1000000 bit/s"),
        ("bring-up can0 --restart-ms -1", "--restart-ms: is -1, expected 0 to 10000 ms"),
        ("bring-up can0 --queue 9", "--queue: is 9, expected 10 to 10000 frames"),
        ("bring-up can0 --install --output x", "--output: is given with --install, which writes to /etc"),
        ("budget --rate 0", "--rate: is 0.0, expected a number above 0"),
        ("budget --bitrate inf", "--bitrate: is inf, expected a number above 0"),
        ("budget --channels virtual:a,virtual:a", "buses 'virtual:a,virtual:a': virtual:a is named twice"),
        ("budget --channels virtual:a,virtual:b,virtual:c", "lite: 3 channels given, expected 1 or one per bus, 2"),
        ("budget --robot none", "unknown robot 'none'"),
        ("calibrate NOBODY", "--duration: is needed where standard input is not a terminal"),
        ("calibrate NOBODY --duration 0", "--duration: is 0.0, expected more than 0 s"),
        ("calibrate NOBODY --duration 1 --joints elbow", "--joints: unknown joint 'elbow'; known: left_shoulder_pitch"),
        ("calibrate NOBODY --duration 1 --threshold nan", "--threshold: is nan, expected a number >= 0, in rad"),
        ("calibrate NOBODY --duration 1 --tolerance -1", "--tolerance: is -1.0, expected a number >= 0, in rad"),
        ("calibrate NOBODY --duration 1 --output /nowhere/c.yaml", "--output: the folder '/nowhere' does not exist"),
        ("discover nonsense:x", "bus 'nonsense:x': unknown interface 'nonsense'; known: "),
        ("discover NOBODY --first 0", "--first, --last: are 0 and 127, expected 1 <= first <= last <= 127"),
        ("discover NOBODY --first 5 --last 4", "--first, --last: are 5 and 4, expected"),
        ("discover NOBODY --wait 0", "--wait: is 0.0, expected more than 0 and at most 10 s"),
        ("discover NOBODY --wait nan", "--wait: is nan, expected"),
        ("discover NOBODY --host-id 256", "--host-id: is 256, expected 0 to 255"),
        ("discover NOBODY --robot lita", "unknown robot 'lita'"),
        ("discover virtual:a,virtual:b,virtual:c --robot lite", "lite: 3 channels given, expected 1"),
        ("emulate --channel virtual:x", "--channel: is 'virtual:x', which no other process can reach"),
        ("emulate --channel SHARED --fault enobufs", "--fault: is 'enobufs@0', which is made at the other"),
        ("emulate --channel SHARED --fault fire", "--fault 'fire': unknown fault 'fire'"),
        ("emulate --channel SHARED --firmware rs-02", "--firmware: is 'rs-02', expected JOINT=VERSION"),
        ("emulate --channel SHARED --firmware rs-09=0.2.3.5", "firmware: unknown joint or motor model 'rs-09'"),
        ("emulate --channel SHARED --firmware rs-02=0.1.3.5", "firmware of left_shoulder_pitch: is 0.1.3.5"),
        ("emulate --channel SHARED --bitrate -1", "bitrate: is -1.0, expected a finite number >= 0"),
        ("emulate --channel SHARED --duration 0", "--duration: is 0.0, expected a finite number above 0"),
        ("emulate --channel SHARED --robot nobody", "unknown robot 'nobody'"),
        ("emulate --channel SHARED,can8,can9", "lite: 3 channels, but its motors are on 1 or 2"),
        ("identify NOBODY elbow", "unknown joint 'elbow'; known: left_shoulder_pitch, "),
        ("identify NOBODY left_wrist_yaw --angle 1", "--angle: is 1.0, expected 0.02 to 0.5 rad"),
        ("identify NOBODY left_wrist_yaw --torque 4.1", "--torque: is 4.1, expected more than 0 and at most 4 N·m"),
        ("identify NOBODY left_wrist_yaw --torque nan", "--torque: is nan, expected"),
        ("param set NOBODY 12 mechPos 1", "mechPos: is read only"),
        ("param set NOBODY 12 zero_sta 0.5", "zero_sta: is 0.5, expected a whole number of type u8"),
        ("param set NOBODY 12 limit_torque nan", "limit_torque: is nan, expected a finite float32"),
        ("param set NOBODY 12 limit_torque 1e39", "limit_torque: is 1e+39, expected a finite float32"),
        ("param set NOBODY 12 limit_torque -5", "limit_torque: is -5, expected 0 to 120 N·m for any model"),
        ("param set NOBODY 12 limit_torque 18 --model rs-02", "limit_torque: is 18, expected 0 to 17 N·m for an rs-02"),
        ("param set NOBODY 12 limit_torque 1 --model rs-22", "unknown motor model 'rs-22'; known: "),
        ("param set NOBODY 12 canTimeout 1e9", "canTimeout: is 1e+09, expected 0 to 100000"),
        ("param set NOBODY 12 0x07028 1e9 --type u32", "canTimeout: is 1e+09, expected 0 to 100000"),
        ("param set NOBODY 12 0b111000000011000 200 --type f32", "limit_cur: is 200, expected 0 to 90 A for any model"),
        ("param set NOBODY 12 0o70013 -5 --type f32", "limit_torque: is -5, expected 0 to 120 N·m for any model"),
        ("param set NOBODY 12 0x07019 1 --type f32", "mechPos: is read only"),
        ("param set NOBODY 12 0x7028 5 --type f32", "--type: is f32, canTimeout is a u32"),
        ("param set NOBODY 12 run_mode 9", "run_mode: is 9, expected 0, 1, 2, 3, 5"),
        ("param set NOBODY 12 EPScan_time 0", "EPScan_time: is 0, expected 1 to 65535"),
        ("param set NOBODY 12 cur_filter_gain 1.5", "cur_filter_gain: is 1.5, expected 0 to 1"),
        ("param set NOBODY 12 damper 1", "damper: is 1, expected 0"),
        ("param get NOBODY 12 speed", "unknown parameter 'speed'; known: run_mode"),
        ("param get NOBODY 12 0x3022", "--type: is needed for 0x3022, which has no name here"),
        ("param get NOBODY 12 0x13022 --type u8", "parameter: is 0x13022, expected an index of 0 to 0xFFFF"),
        ("param get NOBODY 12 VBUS --type u8", "--type: is u8, VBUS is a f32"),
        ("ping NOBODY 0", "motor id: is 0, expected 1 to 127"),
        ("ping NOBODY 128", "motor id: is 128, expected 1 to 127"),
        ("ping NOBODY 13 --count 0", "--count: is 0, expected 1 to 10000"),
        ("ping NOBODY 13 --model rs-9", "unknown motor model 'rs-9'; known: rs-00, "),
        ("set-id NOBODY 0", "new id: is 0, expected 1 to 127\n"),
        ("set-id NOBODY 128", "new id: is 128, expected 1 to 127\n"),
        ("set-id NOBODY -1", "new id: is -1, expected 1 to 127\n"),
    ],
)
def test_options_that_are_not_accepted_are_one_line_and_leave_nothing(run, tmp_path, monkeypatch, line, message):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.chdir(tmp_path)
    status, printed, complained = run(*_words(line))
    assert (status, printed) == (2, "")
    assert complained.startswith(f"error: {message}")
    assert complained.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("line", "motor"),
    [("ping NOBODY 40", 40), ("param set NOBODY 40 zero_sta 1", 40), ("identify NOBODY left_wrist_yaw --yes", 15)],
)
def test_status_3_where_the_motor_is_silent(run, line, motor):
    status, _, complained = run(*_words(line))
    assert (status, complained) == (3, f"error: motor {motor} does not answer on virtual:nobody\n")
