import configparser
import io
import json
import stat

import pytest

from humanoid_sim.hardware.tools import bring_up as tool

_TWO = ("bring-up", "can_left,can_right", "--adapter", "can_left=0042/1", "--adapter", "can_right=0051")
_PATHS = (
    "udev/rules.d/70-humanoid-can.rules",
    "systemd/network/25-can_left.network",
    "systemd/network/25-can_right.network",
)


def _network(path):
    parser = configparser.ConfigParser()
    parser.optionxform = str
    parser.read_string(path.read_text(encoding="utf-8"))
    return {section: dict(parser[section]) for section in parser.sections()}


def _rules(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line.split(", ") for line in lines if not line.startswith("#")]


def test_the_files_lie_in_a_folder_as_below_etc(run, tmp_path):
    status, printed, complained = run(*_TWO, "--output", str(tmp_path))
    assert (status, complained) == (0, "")
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()) == sorted(_PATHS)
    assert _network(tmp_path / _PATHS[1]) == {
        "Match": {"Name": "can_left"},
        "Link": {"RequiredForOnline": "no"},
        "CAN": {"BitRate": "1000000", "RestartSec": "0"},
    }
    head, queue = ['SUBSYSTEM=="net"', 'ACTION=="add"', 'ATTR{type}=="280"'], 'ATTR{tx_queue_len}="100"'
    assert _rules(tmp_path / _PATHS[0]) == [
        [*head, 'ATTRS{serial}=="0042"', 'ATTR{dev_port}=="1"', 'NAME="can_left"', queue],
        [*head, 'ATTRS{serial}=="0051"', 'NAME="can_right"', queue],
    ]
    assert all(stat.S_IMODE((tmp_path / path).stat().st_mode) == 0o644 for path in _PATHS)
    assert f"sudo cp -r {tmp_path}/. /etc/" in printed
    assert printed.splitlines()[-2:] == [
        "  python -m humanoid_sim.hardware bring-up can_left,can_right --check",
        "No real adapter was there to try this on: look at what --check says, and at your adapter's own manual.",
    ]


def test_other_settings_reach_the_files_and_the_check_that_is_named(run, tmp_path):
    settings = ("--bitrate", "500000", "--restart-ms", "100", "--queue", "250")
    _, printed, _ = run("bring-up", "can0", "--output", str(tmp_path), *settings)
    assert _network(tmp_path / "systemd/network/25-can0.network")["CAN"] == {"BitRate": "500000", "RestartSec": "100ms"}
    assert _rules(tmp_path / _PATHS[0]) == [
        ['SUBSYSTEM=="net"', 'ACTION=="add"', 'ATTR{type}=="280"', 'KERNEL=="can0"', 'ATTR{tx_queue_len}="250"']
    ]
    assert "bring-up can0 --bitrate 500000 --restart-ms 100 --queue 250 --check" in printed


def test_without_a_folder_the_files_are_printed_only(run, tmp_path, monkeypatch):
    monkeypatch.setattr(tool, "_ETC", tmp_path)
    status, printed, complained = run("bring-up", "can0")
    assert status == 0
    assert "BitRate=1000000\nRestartSec=0\n" in printed
    assert "left and right may change places" in complained
    assert list(tmp_path.iterdir()) == []


def test_a_different_file_is_not_replaced_in_a_folder(run, tmp_path):
    assert run(*_TWO, "--output", str(tmp_path))[0] == 0
    assert run(*_TWO, "--output", str(tmp_path))[0] == 0  # the same once more
    before = {path: (tmp_path / path).read_bytes() for path in _PATHS}
    status, _, complained = run(*_TWO, "--output", str(tmp_path), "--bitrate", "500000")
    assert status == 2
    assert f"'{tmp_path / _PATHS[1]}' exists and is different" in complained
    assert {path: (tmp_path / path).read_bytes() for path in _PATHS} == before


@pytest.mark.parametrize("answer", ["yes\n", "no\n", ""])
def test_etc_is_written_after_a_confirmation_only(run, tmp_path, monkeypatch, answer):
    old = tmp_path / _PATHS[0]
    old.parent.mkdir(parents=True)
    old.write_text("old", encoding="utf-8")
    terminal = io.StringIO(answer)
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", terminal)
    monkeypatch.setattr(tool, "_ETC", tmp_path)
    status, printed, complained = run(*_TWO, "--install")
    assert f"{tmp_path / _PATHS[0]}: replaces what is there\n{tmp_path / _PATHS[1]}: new\n" in printed
    if answer == "yes\n":
        assert (status, complained) == (0, "")
        assert len(_rules(old)) == 2
        assert _network(tmp_path / _PATHS[2])["Match"] == {"Name": "can_right"}
    else:
        assert (status, complained) == (2, "error: nothing was written: not confirmed\n")
        assert old.read_text(encoding="utf-8") == "old"
        assert not (tmp_path / _PATHS[1]).exists()


def test_the_whole_of_it_is_written_or_nothing(run, tmp_path):
    (tmp_path / "systemd").write_text("in the way", encoding="utf-8")
    status, _, complained = run(*_TWO, "--output", str(tmp_path))
    assert status == 2
    assert complained.startswith(f"error: {tmp_path}/systemd/network: cannot be made: ")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [tmp_path / "systemd"]


def _sysfs(folder, name, serial, port):
    device = folder / "devices" / serial
    (device / "1-1:1.0").mkdir(parents=True, exist_ok=True)
    (device / "serial").write_text(f"{serial}\n", encoding="utf-8")
    (folder / "net" / name).mkdir(parents=True)
    (folder / "net" / name / "device").symlink_to(device / "1-1:1.0")
    (folder / "net" / name / "dev_port").write_text(f"{port}\n", encoding="utf-8")


def test_adapters_that_are_plugged_in_are_told_with_their_serial_numbers(run, tmp_path, monkeypatch):
    _sysfs(tmp_path, "can0", "003A00215542500520353233", 1)
    (tmp_path / "net" / "can1").mkdir()
    monkeypatch.setattr(tool, "_SYSFS", tmp_path / "net")
    monkeypatch.setattr(tool, "can_interfaces", lambda: ["can0", "can1"])
    _, printed, _ = run("bring-up", "can0")
    assert "# plugged in: can0, --adapter NAME=003A00215542500520353233/1\n" in printed
    assert "# plugged in: can1, tells no serial number\n" in printed


def test_the_check_is_a_verdict_and_an_exit_status(run, monkeypatch):
    data = {"state": "ERROR-ACTIVE", "restart_ms": 0, "bittiming": {"bitrate": 1000000}}
    info = {"info_kind": "can", "info_data": data}
    link = {"ifname": "can0", "flags": ["UP"], "txqlen": 100, "link_type": "can", "linkinfo": info}
    monkeypatch.setattr(tool, "read_links", lambda: json.dumps([link]))
    status, printed, _ = run("bring-up", "can0", "--check")
    assert status == 0
    assert printed.splitlines() == [
        "can0: up; 1000000 bit/s; restart-ms 0; no errors (ERROR-ACTIVE); queue 100",
        "verdict: set up as wanted. No real adapter was there to try this on: look at what --check says, and at your "
        "adapter's own manual.",
    ]
    status, printed, _ = run("bring-up", "can0,can1", "--check", "--bitrate", "500000")
    assert status == 1
    assert "problem: can0: its bit rate is 1000000 bit/s, expected 500000" in printed
    assert "problem: can1: there is no such network interface; CAN interfaces of this machine: can0" in printed
    assert "verdict: not set up as wanted." in printed
