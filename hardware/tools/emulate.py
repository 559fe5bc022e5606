"""`hardware emulate`: mock motors in a process of their own."""

from __future__ import annotations

import signal
import time

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.can_bus import parse_addresses
from humanoid_sim.hardware.mock.faults import parse_fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion, parse_version
from humanoid_sim.hardware.tools.options import Emulate
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.session.realtime import punctual_threads

_WAKE = 0.05  # s between two checks for an end


def _version(text: str) -> tuple[str, FirmwareVersion]:
    model, _, version = text.partition("=")
    require_known("motor model", [model], MOTORS, "--firmware: ")
    return model, parse_version(version)


def emulate(config: Emulate) -> int:
    """Run until a signal ends it; returns the exit status."""
    description, addresses = load_robot(config.robot), parse_addresses(config.channel)
    for address in addresses:
        if address.interface == "virtual":
            raise InputError(f"--channel: is '{address}', expected one between processes: vcan0 or udp_multicast:…")
    faults = [parse_fault(text, description) for text in config.fault]
    versions, offsets = dict(map(_version, config.firmware)), {}
    if config.calibration is not None:
        entries = load_calibration(config.calibration, description).entries
        offsets = {name: entries[name].homing_offset or 0.0 for name in description.joint_names if name in entries}

    def log(when: float, text: str) -> None:
        if not config.quiet:
            print(f"{when:9.3f} s  {text}", flush=True)

    signals: list[int] = []
    handlers = {
        number: signal.signal(number, lambda number, _: signals.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        with punctual_threads(behind=10) as punctuality:
            motors = MockServer(description, addresses, homing_offset=offsets, log=log)
        with motors:
            motors.set_versions(versions)
            for fault in faults:
                motors.inject(fault)
            who = f"{description.joint_count} motors of {description.name}"
            print(f"{who} on {config.channel}; {punctuality}", flush=True)
            while motors.failure is None and not signals:
                time.sleep(_WAKE)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return 0
