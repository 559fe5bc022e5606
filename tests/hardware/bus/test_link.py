"""The check of a CAN interface, on what `ip -details -json link show` prints (iproute2 5.10 to 6.1)."""

import copy
import json
import subprocess

import pytest

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus import link
from humanoid_sim.hardware.bus.link import LinkSettings, check_link, read_links
from humanoid_sim.hardware.checks import CheckList

# fmt: off
_LOOPBACK = {"ifindex": 1, "ifname": "lo", "flags": ["LOOPBACK", "UP", "LOWER_UP"], "mtu": 65536, "qdisc": "noqueue",
             "operstate": "UNKNOWN", "linkmode": "DEFAULT", "group": "default", "txqlen": 1000,
             "link_type": "loopback", "address": "00:00:00:00:00:00", "broadcast": "00:00:00:00:00:00"}
# A USB adapter of the driver gs_usb, up at 1 Mbit/s.
_RIGHT = {
    "ifindex": 7, "ifname": "can0", "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"], "mtu": 16, "qdisc": "pfifo_fast",
    "operstate": "UP", "linkmode": "DEFAULT", "group": "default", "txqlen": 100, "link_type": "can",
    "promiscuity": 0, "allmulti": 0, "min_mtu": 0, "max_mtu": 0,
    "linkinfo": {"info_kind": "can", "info_data": {
        "ctrlmode_supported": ["LOOPBACK", "LISTEN-ONLY", "ONE-SHOT"],
        "state": "ERROR-ACTIVE", "berr_counter": {"tx": 0, "rx": 0}, "restart_ms": 0,
        "bittiming": {"bitrate": 1000000, "sample_point": "0.750", "tq": 62, "prop_seg": 5, "phase_seg1": 6,
                      "phase_seg2": 4, "sjw": 1, "brp": 3},
        "bittiming_const": {"name": "gs_usb", "tseg1": {"min": 1, "max": 16}, "tseg2": {"min": 1, "max": 8},
                            "sjw": {"min": 1, "max": 4}, "brp": {"min": 1, "max": 1024}, "brp_inc": 1},
        "clock": 48000000}},
    "num_tx_queues": 1, "num_rx_queues": 1, "gso_max_size": 65536, "gso_max_segs": 65535,
    "parentbus": "usb", "parentdev": "2-1.4:1.0"}
# The same one as it comes: no bit rate yet, and the kernel's short queue.
_FRESH = {**_RIGHT, "flags": ["NOARP", "ECHO"], "qdisc": "noop", "operstate": "DOWN", "txqlen": 10,
          "linkinfo": {"info_kind": "can", "info_data": {
              "state": "STOPPED", "restart_ms": 0,
              "bittiming_const": _RIGHT["linkinfo"]["info_data"]["bittiming_const"], "clock": 48000000}}}
_VIRTUAL = {"ifindex": 9, "ifname": "vcan0", "flags": ["NOARP", "UP", "LOWER_UP"], "mtu": 72, "qdisc": "noqueue",
            "operstate": "UNKNOWN", "txqlen": 1000, "link_type": "can", "linkinfo": {"info_kind": "vcan"}}
# fmt: on


def _changed(**data):
    """The right one with other data of its controller; None takes a field away."""
    changed = copy.deepcopy(_RIGHT)
    info = changed["linkinfo"]["info_data"]
    info.update(data)
    for name in [name for name, value in data.items() if value is None]:
        del info[name]
    return changed


def _bittiming(bitrate):
    return {**_RIGHT["linkinfo"]["info_data"]["bittiming"], "bitrate": bitrate}


def _found(*links, name="can0", wanted=None):
    checks = CheckList()
    check_link(json.dumps([_LOOPBACK, {}, *links]), name, wanted or LinkSettings(), checks)
    return checks


_UP = "sudo ip link set can0 up type can bitrate 1000000 restart-ms 0"
_AGAIN = f"sudo ip link set can0 down, then {_UP}"


def test_an_interface_that_is_set_up_as_wanted():
    checks = _found(_RIGHT)
    assert [str(check) for check in checks.all] == [
        "can0: up; 1000000 bit/s; restart-ms 0; no errors (ERROR-ACTIVE); queue 100"
    ]


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"bittiming": _bittiming(500000)}, f"its bit rate is 500000 bit/s, expected 1000000: {_AGAIN}"),
        ({"bittiming": None}, f"has no bit rate, expected 1000000 bit/s: {_AGAIN}"),
        ({"restart_ms": 100}, f"its restart-ms is 100, expected 0: {_AGAIN}"),
        ({"restart_ms": None}, f"its restart-ms is not told, expected 0: {_AGAIN}"),
        (
            {"state": "BUS-OFF", "berr_counter": {"tx": 248, "rx": 0}},
            "is bus-off: it has left the bus after too many errors; check cable, terminators and bit rate",
        ),
        ({"ctrlmode": ["LISTEN-ONLY"]}, "only listens (listen-only): it sends nothing and acknowledges nothing"),
        ({"ctrlmode": ["LOOPBACK"]}, "is looped back onto itself (loopback)"),
        ({"ctrlmode": ["ONE-SHOT"]}, "sends each frame once only (one-shot): a frame that loses arbitration is lost"),
    ],
)
def test_what_is_wrong_with_one(changes, problem):
    checks = _found(_changed(**changes))
    assert checks.problems == (f"can0: {problem}",)
    assert checks.warnings == ()


def test_one_that_is_down():
    assert _found({**_RIGHT, "flags": ["NOARP", "ECHO"]}).problems == (f"can0: is down: {_UP}",)


def test_an_adapter_as_it_comes_lacks_everything():
    checks = _found(_FRESH)
    assert [problem.partition(": ")[2].partition(",")[0].partition(":")[0] for problem in checks.problems] == [
        "is down",
        "has no bit rate",
        "is stopped",
    ]
    assert checks.warnings == (
        "can0: its outgoing queue takes 10 frames, expected 100: sudo ip link set can0 txqueuelen 100",
    )


def test_errors_on_the_bus_are_a_warning_with_their_counters():
    checks = _found(_changed(state="ERROR-PASSIVE", berr_counter={"tx": 128, "rx": 135}))
    assert checks.problems == ()
    assert checks.warnings == (
        "can0: has many errors (ERROR-PASSIVE): nobody acknowledges, or the bus is damaged; error counters: sending "
        "128, receiving 135",
    )
    assert _found(_changed(state="ERROR-WARNING", berr_counter=None)).warnings == (
        "can0: has had errors (ERROR-WARNING)",
    )


def test_another_bit_rate_and_restart_may_be_wanted():
    found = _changed(bittiming=_bittiming(500000), restart_ms=100)
    assert _found(found, wanted=LinkSettings(500_000, 100)).problems == ()


def test_a_virtual_interface_has_no_controller():
    checks = _found(_VIRTUAL, name="vcan0")
    assert checks.problems == ()
    assert checks.warnings == ("vcan0: is not a controller, but of the kind vcan: it has no bit rate",)


def test_an_interface_that_is_not_there_or_no_can():
    assert _found(_RIGHT, name="can1").problems == (
        "can1: there is no such network interface; CAN interfaces of this machine: can0",
    )
    assert _found(name="can1").problems[0].endswith("CAN interfaces of this machine: none")
    assert _found(name="lo").problems == ("lo: is not a CAN interface, but of type loopback",)


@pytest.mark.parametrize("text", ["", "{}", "[1]", "Device does not exist", "[" * 100_000])
def test_what_is_no_output_of_that_command(text):
    with pytest.raises(RobotError, match=r"ip -details -json link show: did not print a list in JSON"):
        check_link(text, "can0", LinkSettings(), CheckList())


@pytest.mark.parametrize(
    "info", [None, 5, {"info_data": 3}, {"info_kind": "can", "info_data": {"bittiming": [], "ctrlmode": 1}}]
)
def test_fields_of_another_kind_are_told_as_missing(info):
    assert _found({**_RIGHT, "linkinfo": info, "flags": None}).problems


def test_the_command_is_run(monkeypatch):
    def run(words, **_):
        assert words == ("ip", "-details", "-json", "link", "show")
        return subprocess.CompletedProcess(words, 255, "", "Cannot open netlink socket\n")

    monkeypatch.setattr(link.subprocess, "run", run)
    with pytest.raises(RobotError, match=r"link show: Cannot open netlink socket$"):
        read_links()


def test_without_the_command(monkeypatch):
    monkeypatch.setattr(link, "_COMMAND", ("no-such-program-as-ip",))
    with pytest.raises(RobotError, match="there is no program 'ip'; install the package iproute2"):
        read_links()
