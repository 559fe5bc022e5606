"""`hardware bring-up`: what sets a computer's CAN interfaces up at every start, and whether they are set up so."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.hardware.bus.address import can_interfaces, parse_addresses
from humanoid_sim.hardware.bus.link import LinkSettings, check_link, read_links
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.tools.options import BringUp
from humanoid_sim.hardware.tools.terminal import confirm

_ETC = Path("/etc")
_SYSFS = Path("/sys/class/net")
_RULES = Path("udev/rules.d/70-humanoid-can.rules")
"""Before udev's own 80-net-setup-link.rules, which name what has no name yet."""
_HIGHEST_PORT = 15
_PLACEHOLDER = "SERIAL"
"""Placeholder for a serial number in help and pages."""
_NOT_TRIED = "No real adapter was there to try this on: look at what --check says, and at your adapter's own manual."
_HEADING = """\
# CAN interfaces of a robot. Written by `python -m humanoid_sim.hardware bring-up`.
"""


@dataclass(frozen=True, slots=True)
class Adapter:
    """A USB adapter, by which an interface gets its name."""

    serial: str
    port: int | None = None
    """Number of the port of an adapter with several, from 0."""


def bring_up(config: BringUp) -> int:
    """Print, write or check, and return the exit status."""
    names = _names(config.channels)
    adapters = _adapters(config.adapter, names)
    wanted = _settings(config)
    if config.check:
        return _check(names, wanted)
    if config.install and config.output is not None:
        raise InputError("--output: is given with --install, which writes to /etc; expected one of the two")
    files = network_files(names, adapters, wanted)
    for name in names:
        if name not in adapters:
            complain(
                f"warning: {name}: without --adapter {name}=SERIAL the kernel numbers interfaces in the order in which "
                "it finds them: left and right may change places"
            )
    if config.install:
        _install(files, config.yes)
    elif config.output is not None:
        _write(files, config.output)
    else:
        for path, text in files.items():
            print(f"--- {_ETC / path}\n{text}")
        for adapter in _plugged_in():
            print(f"# plugged in: {adapter}")
    _print_next(config, names)
    return 0


# --- what is asked for


def _names(channels: str) -> tuple[str, ...]:
    addresses = parse_addresses(channels)
    for address in addresses:
        if address.interface != "socketcan":
            raise InputError(
                f"channels: '{address}' is not a network interface; expected names such as can0 or can_left"
            )
        if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", address.channel):
            raise InputError(
                f"channels: '{address}' has characters that udev reads otherwise; expected letters, digits, _, . and -"
            )
    return tuple(address.channel for address in addresses)


def _adapters(texts: Sequence[str], names: Sequence[str]) -> dict[str, Adapter]:
    """Return the adapter of each interface that has one."""
    adapters: dict[str, Adapter] = {}
    for text in texts:
        match = re.fullmatch(r"([^=]+)=([A-Za-z0-9._:-]{1,64})(?:/(\d{1,2}))?", text)
        if match is None or int(match[3] or 0) > _HIGHEST_PORT:
            raise InputError(
                f"--adapter: is '{text}', expected NAME=SERIAL or NAME=SERIAL/PORT, such as can_left=0042/1"
            )
        name, adapter = match[1], Adapter(match[2], None if match[3] is None else int(match[3]))
        if adapter.serial == _PLACEHOLDER:
            there = "; ".join(_plugged_in()) or "none"
            raise InputError(
                f"--adapter: is '{text}', where {_PLACEHOLDER} stands for the adapter's serial number; "
                f"plugged in: {there}"
            )
        if name not in names:
            raise InputError(f"--adapter: '{text}' names no channel; the channels are {', '.join(names)}")
        if name in adapters:
            raise InputError(f"--adapter: {name} is given twice")
        for other, taken in adapters.items():
            if taken.serial == adapter.serial and (taken.port == adapter.port or None in (taken.port, adapter.port)):
                raise InputError(f"--adapter: {other} and {name} are one adapter and port; expected different ones")
        if re.fullmatch(r"can\d+", name):
            raise InputError(
                f"--adapter: {name} is a name that the kernel gives by itself, perhaps to another adapter first; "
                "expected one of your own such as can_left"
            )
        adapters[name] = adapter
    return adapters


def _settings(config: BringUp) -> LinkSettings:
    for name, value, lowest, highest, what in (
        ("--bitrate", config.bitrate, 10_000, 1_000_000, "bit/s; motors come with 1000000"),
        ("--restart-ms", config.restart_ms, 0, 10_000, "ms; 0: never by itself"),
        ("--queue", config.queue, 10, 10_000, "frames"),
    ):
        if not lowest <= value <= highest:
            raise InputError(f"{name}: is {value}, expected {lowest} to {highest} {what}")
    return LinkSettings(config.bitrate, config.restart_ms, config.queue)


# --- the files


def network_files(names: Sequence[str], adapters: Mapping[str, Adapter], wanted: LinkSettings) -> dict[Path, str]:
    """Return the files, by their paths below /etc: one for udev, and one for systemd-networkd for each interface."""
    files = {_RULES: _HEADING + "".join(_rule(name, adapters.get(name), wanted) for name in names)}
    for name in names:
        files[Path(f"systemd/network/25-{name}.network")] = (
            f"{_HEADING}[Match]\nName={name}\n\n"
            "[Link]\n# it never gets an address: starting the computer must not wait for one\nRequiredForOnline=no\n\n"
            f"[CAN]\nBitRate={wanted.bitrate}\nRestartSec={f'{wanted.restart_ms}ms' if wanted.restart_ms else 0}\n"
        )
    return files


def _rule(name: str, adapter: Adapter | None, wanted: LinkSettings) -> str:
    matches = ['SUBSYSTEM=="net"', 'ACTION=="add"', 'ATTR{type}=="280"']
    actions = [f'ATTR{{tx_queue_len}}="{wanted.queue}"']
    if adapter is None:
        matches.append(f'KERNEL=="{name}"')
    else:
        matches.append(f'ATTRS{{serial}}=="{adapter.serial}"')
        actions.insert(0, f'NAME="{name}"')
        if adapter.port is not None:
            matches.append(f'ATTR{{dev_port}}=="{adapter.port}"')
    return ", ".join([*matches, *actions]) + "\n"


def _write(files: Mapping[Path, str], folder: Path) -> None:
    """Write all files below a folder, none over another's."""
    paths = {folder / path: text for path, text in files.items()}
    for path, text in paths.items():
        if path.exists() and _content(path) != text:
            raise InputError(f"--output: '{path}' exists and is different; choose another folder, or remove it")
    _write_all(paths)
    for path in paths:
        print(f"wrote {path}")


def _install(files: Mapping[Path, str], yes: bool) -> None:
    paths = {_ETC / path: text for path, text in files.items()}
    for path, text in paths.items():
        there = _content(path)
        state = "new" if there is None else "unchanged" if there == text else "replaces what is there"
        print(f"{path}: {state}")
    confirm("Write these files?", yes, "nothing was written")
    _write_all(paths)
    print(f"wrote {len(paths)} files")


def _write_all(paths: Mapping[Path, str]) -> None:
    """Look at every place first, so that either all files are written or none."""
    for path in paths:
        with blaming(f"{path.parent}: cannot be made", OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
        output_file(path, "bring-up")
    for path, text in paths.items():
        with whole_file(path) as file:
            file.write(text.encode())
        path.chmod(0o644)


def _content(path: Path) -> str | None:
    """Return what a file holds; none if it is not there or cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


# --- what is there


def _plugged_in() -> Iterator[str]:
    """Each interface that is there, and the option that names it."""
    for name in can_interfaces():
        adapter = _adapter_of(name)
        told = "tells no serial number" if adapter is None else f"--adapter NAME={adapter.serial}/{adapter.port or 0}"
        yield f"{name}, {told}"


def _adapter_of(name: str) -> Adapter | None:
    """Return the USB device above an interface."""
    try:
        device = (_SYSFS / name / "device").resolve(strict=True)
        port = int(_content(_SYSFS / name / "dev_port") or 0)
    except (OSError, ValueError):
        return None
    for folder in (device, *device.parents):
        serial = _content(folder / "serial")
        if serial is not None and serial.strip():
            return Adapter(serial.strip(), port)
    return None


def _check(names: Sequence[str], wanted: LinkSettings) -> int:
    checks = CheckList()
    text = read_links()
    for name in names:
        check_link(text, name, wanted, checks)
    for check in checks.all:
        print(check)
    ready = not checks.problems
    print(f"verdict: {'set up as wanted' if ready else 'not set up as wanted'}. {_NOT_TRIED}")
    return ExitStatus.of(ready)


def _print_next(config: BringUp, names: Sequence[str]) -> None:
    if config.install:
        print("Then:")
    elif config.output is not None:
        print(f"Then:\n  sudo cp -r {config.output}/. /etc/")
    else:
        print("To use them: --output FOLDER and sudo cp -r FOLDER/. /etc/, or --install as root. Then:")
    print("  sudo udevadm control --reload")
    print("  sudo systemctl enable --now systemd-networkd && sudo networkctl reload")
    print("  unplug the adapters and plug them in again")
    differing = "".join(
        f" --{option} {value}"
        for option, value, usual in (
            ("bitrate", config.bitrate, LinkSettings().bitrate),
            ("restart-ms", config.restart_ms, LinkSettings().restart_ms),
            ("queue", config.queue, LinkSettings().queue),
        )
        if value != usual
    )
    print(f"  python -m humanoid_sim.hardware bring-up {','.join(names)}{differing} --check")
    print(_NOT_TRIED)
