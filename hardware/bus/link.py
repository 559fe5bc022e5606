"""Settings of a CAN interface in the kernel, as `ip -details -json link` shows them, compared with what motors need.

Tried on output that others recorded with the drivers gs_usb, mcp251xfd, sun4i_can and usb_8dev; no adapter was there to
run it on.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from humanoid_sim.errors import RobotError, one_line
from humanoid_sim.hardware.bus.frame import BITRATE
from humanoid_sim.hardware.checks import CheckList, Verdict

_COMMAND = ("ip", "-details", "-json", "link", "show")
_TIMEOUT = 5.0
"""s"""
_STATES = {
    "ERROR-ACTIVE": (Verdict.PASSED, "no errors (ERROR-ACTIVE)"),
    "ERROR-WARNING": (Verdict.WARNING, "has had errors (ERROR-WARNING)"),
    "ERROR-PASSIVE": (Verdict.WARNING, "has many errors (ERROR-PASSIVE): nobody acknowledges, or the bus is damaged"),
    "BUS-OFF": (
        Verdict.PROBLEM,
        "is bus-off: it has left the bus after too many errors; check cable, terminators and bit rate",
    ),
    "STOPPED": (Verdict.PROBLEM, "is stopped"),
    "SLEEPING": (Verdict.PROBLEM, "sleeps"),
}
_WRONG_MODES = {
    "LISTEN-ONLY": "only listens (listen-only): it sends nothing and acknowledges nothing",
    "LOOPBACK": "is looped back onto itself (loopback)",
    "ONE-SHOT": "sends each frame once only (one-shot): a frame that loses arbitration is lost",
}


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """Settings that an interface should have."""

    bitrate: int = BITRATE
    """bit/s"""
    restart_ms: int = 0
    """ms after which the controller returns by itself when it was bus-off; 0: never, somebody looks at it first."""
    queue: int = 100
    """Frames that the kernel may hold back (`txqueuelen`), at least."""


def configured_by_hand(name: str, wanted: LinkSettings) -> tuple[str, str]:
    """Return the commands that set an interface up until the next restart."""
    can = f"type can bitrate {wanted.bitrate} restart-ms {wanted.restart_ms}"
    return f"sudo ip link set {name} up {can}", f"sudo ip link set {name} txqueuelen {wanted.queue}"


def read_links() -> str:
    """Return what `ip -details -json link show` prints; a `RobotError` where there is no such program, or it fails."""
    command = " ".join(_COMMAND)
    try:
        done = subprocess.run(_COMMAND, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
    except FileNotFoundError:
        raise RobotError(f"{command}: there is no program 'ip'; install the package iproute2") from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RobotError(f"{command}: {one_line(str(error))}") from None
    if done.returncode:
        raise RobotError(f"{command}: {one_line(done.stderr) or f'exit status {done.returncode}'}")
    return done.stdout


def check_link(text: str, name: str, wanted: LinkSettings, checks: CheckList) -> None:
    """Compare an interface in what `read_links` gave with what is wanted of it.

    Raises `RobotError` if the text is not that command's.
    """
    links = _links(text)
    link = links.get(name)
    if link is None:
        present = ", ".join(other for other, found in links.items() if found.get("link_type") == "can") or "none"
        checks.problem(name, f"there is no such network interface; CAN interfaces of this machine: {present}")
        return
    info = _mapping(link.get("linkinfo"))
    if link.get("link_type") != "can":
        checks.problem(name, f"is not a CAN interface, but of type {link.get('link_type', 'unknown')}")
        return
    if "UP" in _texts(link.get("flags")):
        checks.passed(name, "up")
    else:
        checks.problem(name, f"is down: {configured_by_hand(name, wanted)[0]}")
    if info.get("info_kind") == "can":
        _check_controller(_mapping(info.get("info_data")), name, wanted, checks)
    else:
        checks.warn(
            name, f"is not a controller, but of the kind {info.get('info_kind', 'unknown')}: it has no bit rate"
        )
    queue = link.get("txqlen")
    if isinstance(queue, int) and queue >= wanted.queue:
        checks.passed(name, f"queue {queue}")
    else:
        command = configured_by_hand(name, wanted)[1]
        checks.warn(name, f"its outgoing queue takes {_told(queue)} frames, expected {wanted.queue}: {command}")


def _links(text: str) -> dict[str, Mapping[str, Any]]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, list) or not all(isinstance(link, dict) for link in document):
        raise RobotError(f"{' '.join(_COMMAND)}: did not print a list in JSON")
    # A filtered list has an empty mapping for every interface that was left out.
    return {link["ifname"]: link for link in document if isinstance(link.get("ifname"), str)}


def _check_controller(data: Mapping[str, Any], name: str, wanted: LinkSettings, checks: CheckList) -> None:
    again = f"sudo ip link set {name} down, then {configured_by_hand(name, wanted)[0]}"
    bitrate = _mapping(data.get("bittiming")).get("bitrate")
    if bitrate == wanted.bitrate:
        checks.passed(name, f"{bitrate} bit/s")
    elif bitrate is None:
        checks.problem(name, f"has no bit rate, expected {wanted.bitrate} bit/s: {again}")
    else:
        checks.problem(name, f"its bit rate is {bitrate} bit/s, expected {wanted.bitrate}: {again}")
    restart = data.get("restart_ms")
    if restart == wanted.restart_ms:
        checks.passed(name, f"restart-ms {restart}")
    else:
        checks.problem(name, f"its restart-ms is {_told(restart)}, expected {wanted.restart_ms}: {again}")
    state = data.get("state")
    verdict, text = _STATES.get(str(state), (Verdict.WARNING, f"its state is {_told(state)}, expected ERROR-ACTIVE"))
    counters = _mapping(data.get("berr_counter"))
    if counters and state in _STATES and verdict is Verdict.WARNING:
        text += f"; error counters: sending {_told(counters.get('tx'))}, receiving {_told(counters.get('rx'))}"
    checks.add(verdict, name, text)
    for mode, text in _WRONG_MODES.items():
        if mode in _texts(data.get("ctrlmode")):
            checks.problem(name, text)


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _texts(value: Any) -> Sequence[str]:
    return [item for item in value if isinstance(item, str)] if isinstance(value, list) else []


def _told(value: Any) -> str:
    return "not told" if value is None else repr(value)[:40]
