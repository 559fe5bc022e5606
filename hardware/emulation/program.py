"""`hardware emulate`: motors in a process of their own."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from types import FrameType

from rich.console import Console

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.bus.address import BusAddress, parse_addresses
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.emulation.config import EmulateConfig
from humanoid_sim.hardware.emulation.faults import Fault, describe_faults, parse_fault
from humanoid_sim.hardware.emulation.hand import HandSweep
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robstride.scale import Scale
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.session.realtime import punctual_threads

__all__ = ["emulate"]

_WAKE = 0.05
"""s between two looks at what should end the program."""


def emulate(config: EmulateConfig) -> int:
    """Run until a signal or the duration ends it; 0.

    Raises:
        InputError: an option is not accepted.
        RobotError: a channel cannot be opened, or the emulation fails.
    """
    if "help" in config.fault:
        print(describe_faults())
        return 0
    description = load_robot(config.robot)
    addresses = parse_addresses(config.channel)
    _refuse_virtual(addresses)
    faults = [parse_fault(text, description) for text in config.fault]
    _refuse_host_faults(faults)
    if config.duration is not None and not (math.isfinite(config.duration) and config.duration > 0.0):
        raise InputError(f"--duration: is {config.duration}, expected a finite number above 0")
    console = Console(emoji=False, markup=False)

    def told(time: float, text: str) -> None:
        if not config.quiet:
            console.print(f"{time:9.3f} s  {text}")

    ending = threading.Event()
    handlers = [(number, signal.signal(number, _ender(ending))) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        with punctual_threads(behind=0) as punctuality:
            motors = VirtualMotors(
                description, addresses, settings=_settings(config, description), faults=faults, told=told
            )
        with motors:
            channels = ", ".join(str(address) for address in addresses)
            console.print(
                f"{len(motors.joints)} motors of {description.name} on {channels}; {punctuality}", highlight=False
            )
            sweep, begin = HandSweep(description, motors.truth.joint_position), motors.time
            while not ending.wait(_WAKE):
                if motors.failure is not None:
                    raise RobotError(f"{description.name}: the emulation has failed: {motors.failure}")
                if config.sweep:
                    motors.move_by_hand(sweep.at(motors.time - begin))
                if config.duration is not None and motors.time >= config.duration:
                    break
            _report(console, motors, addresses)
    finally:
        for number, handler in handlers:
            signal.signal(number, handler)
    return 0


def _ender(ending: threading.Event) -> Callable[[int, FrameType | None], None]:
    return lambda *_: ending.set()


def _refuse_virtual(addresses: Sequence[BusAddress]) -> None:
    for address in addresses:
        if address.interface == "virtual":
            raise InputError(
                f"--channel: is '{address}', which no other process can reach; expected a CAN interface such as "
                "vcan0, or udp_multicast:239.74.163.2"
            )


def _refuse_host_faults(faults: Sequence[Fault]) -> None:
    for fault in faults:
        if fault.info.scope == "host":
            raise InputError(
                f"--fault: is '{fault}', which is made at the other program's end of the channel; expected a fault of "
                "the motors or the bus"
            )


def _settings(config: EmulateConfig, description: RobotDescription) -> EmulationSettings:
    offsets: Mapping[str, float] = {}
    if config.calibration is not None:
        entries = load_calibration(config.calibration, description).entries
        driven = {joint.name for joint in description.joints if joint.motor is not None}
        offsets = {name: entry.homing_offset for name, entry in entries.items() if name in driven}
    firmware = {}
    for text in config.firmware:
        name, is_given, version = text.partition("=")
        if not is_given:
            raise InputError(f"--firmware: is '{text}', expected JOINT=VERSION or MODEL=VERSION, such as rs-02=0.2.3.5")
        firmware[name.strip()] = version.strip()
    return EmulationSettings(
        homing_offset=offsets,
        firmware=firmware,
        bitrate=config.bitrate,
        scale=Scale(config.scale),
        seed=config.seed,
    )


def _report(console: Console, motors: VirtualMotors, addresses: Sequence[BusAddress]) -> None:
    for bus, address in enumerate(addresses):
        text = f"{address}: {motors.load(bus).frames} frames, {100.0 * motors.bus_load(bus):.1f} % load on average"
        console.print(text)
    if motors.send_errors:
        console.print(f"{motors.send_errors} frames of motors were not taken by their channel")
