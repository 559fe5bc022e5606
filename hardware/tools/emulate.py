"""`hardware emulate`: mock motors in a process of their own."""

from __future__ import annotations

import math
import signal
import time
from queue import SimpleQueue

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import parse_addresses
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.mock.faults import parse_fault
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.tools.options import Emulate
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads

_WAKE = 0.05  # s between two checks for an end


class _Ending:
    """A flag that signal handlers set: an event's lock would deadlock where a second signal interrupts the first."""

    is_set = False

    def set(self, *_: object) -> None:
        self.is_set = True


def emulate(config: Emulate) -> int:
    """Run until a signal or the duration ends it; returns the exit status."""
    description, addresses = load_robot(config.robot), parse_addresses(config.channel)
    for address in addresses:
        if address.interface == "virtual":
            raise InputError(f"--channel: is '{address}', expected one between processes: vcan0 or udp_multicast:…")
    faults = [parse_fault(text, description) for text in config.fault]
    if any(fault.kind == "tx_full" for fault in faults):
        raise InputError("--fault: is tx_full, expected a fault of the motors or the bus")
    duration = math.inf if config.duration is None else config.duration
    if not duration > 0.0:
        raise InputError(f"--duration: is {duration}, expected a number above 0")
    offsets = {}
    if config.calibration is not None:
        entries = load_calibration(config.calibration, description).entries
        offsets = {name: entries[name].homing_offset or 0.0 for name in description.joint_names if name in entries}
    news: SimpleQueue[str] = SimpleQueue()  # printed here: the motors wait for no terminal
    log = None if config.quiet else lambda when, text: news.put(f"{when:9.3f} s  {text}")
    ending = _Ending()
    handlers = {number: signal.signal(number, ending.set) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with punctual_threads(behind=10) as punctuality:
            motors = MockServer(description, addresses, homing_offset=offsets, alone=config.alone, log=log)
        with motors:
            for fault in faults:
                motors.inject(fault)
            who = f"the motor of {config.alone}" if config.alone else f"{description.joint_count} motors"
            print(f"{who} of {description.name} on {config.channel}; {punctuality}", flush=True)
            while motors.failure is None and motors.clock() < duration and not ending.is_set:
                time.sleep(_WAKE)
                while not news.empty():
                    print(news.get(), flush=True)
            if motors.stood_still:
                print(f"the motors stood still for {motors.stood_still:.2f} s: this computer is too slow for them")
    finally:
        for number, handler in handlers.items():  # later ones of a burst would kill the ending process
            signal.signal(number, signal.SIG_IGN if ending.is_set else handler)
    return 0
