"""`hardware emulate`: mock motors in a process of their own."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Sequence
from queue import SimpleQueue

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import BusAddress, parse_addresses
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.mock.faults import Fault, describe_faults, parse_fault
from humanoid_sim.hardware.mock.motors import FACTORY_ID, MockSettings
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.tools.options import Emulate
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.session.realtime import punctual_threads

_WAKE = 0.05  # s between two checks for an end


class _Ending:
    """A flag that signal handlers set: an event's lock would deadlock where a second signal interrupts the first."""

    is_set = False

    def set(self, *_: object) -> None:
        self.is_set = True


def emulate(config: Emulate) -> int:
    """Run until a signal or the duration ends it; returns the exit status."""
    if "help" in config.fault:
        print(describe_faults())
        return 0
    description = load_robot(config.robot)
    addresses = parse_addresses(config.channel)
    faults = [parse_fault(text, description) for text in config.fault]
    _refuse_unreachable(addresses, faults)
    duration = math.inf if config.duration is None else config.duration
    if not duration > 0.0:
        raise InputError(f"--duration: is {duration}, expected a number above 0")
    news: SimpleQueue[str] = SimpleQueue()  # printed here: the motors wait for no terminal
    ending = _Ending()
    handlers = {number: signal.signal(number, ending.set) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with punctual_threads(behind=10) as punctuality:
            motors = MockServer(
                description,
                addresses,
                settings=_settings(config, description),
                log=None if config.quiet else lambda when, text: news.put(f"{when:9.3f} s  {text}"),
            )
        with motors:
            for fault in faults:
                motors.inject(fault)
            who = f"the motor of {config.alone}, id {FACTORY_ID}," if config.alone else f"{len(motors.joints)} motors"
            print(f"{who} of {description.name} on {config.channel}; {punctuality}", flush=True)
            while motors.failure is None and motors.time < duration and not ending.is_set:
                time.sleep(_WAKE)
                while not news.empty():
                    print(news.get(), flush=True)
            if motors.slipped:
                print(f"the motors stood still for {motors.slipped:.2f} s: this computer is too slow for them")
    finally:
        for number, handler in handlers.items():  # later ones of a burst would kill the ending process
            signal.signal(number, signal.SIG_IGN if ending.is_set else handler)
    return 0


def _refuse_unreachable(addresses: Sequence[BusAddress], faults: Sequence[Fault]) -> None:
    """Refuse channels that exist in another process only, and faults of another process's end of a channel."""
    for address in addresses:
        if address.interface == "virtual":
            raise InputError(
                f"--channel: is '{address}', expected one between processes: vcan0 or udp_multicast:239.74.163.2"
            )
    for fault in faults:
        if fault.kind == "tx_full":
            raise InputError(f"--fault: is '{fault}', expected a fault of the motors or the bus")


def _settings(config: Emulate, description: RobotDescription) -> MockSettings:
    offsets: dict[str, float] = {}
    if config.calibration is not None:
        entries = load_calibration(config.calibration, description).entries
        driven = [joint.name for joint in description.joints if joint.motor is not None and joint.name in entries]
        offsets = {name: entries[name].homing_offset or 0.0 for name in driven}
    firmware = {}
    for text in config.firmware:
        name, is_given, version = text.partition("=")
        if not is_given:
            raise InputError(f"--firmware: is '{text}', expected JOINT=VERSION or MODEL=VERSION, such as rs-02=0.2.3.5")
        firmware[name.strip()] = version.strip()
    return MockSettings(offsets, firmware, config.alone, config.seed)
