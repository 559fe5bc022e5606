"""`hardware emulate`: motors in a process of their own."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from queue import SimpleQueue

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import BusAddress, parse_addresses
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.emulation.faults import Fault, describe_faults, parse_fault
from humanoid_sim.hardware.emulation.midi_keyboard import MidiKeyboard
from humanoid_sim.hardware.emulation.motors import FACTORY_ID
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.tools.options import Emulate
from humanoid_sim.mit import KEY_PRESSED, FloatArray
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.session.realtime import punctual_threads

_WAKE = 0.05
"""s between two looks at what should end the program."""


def emulate(config: Emulate) -> int:
    """Run until a signal or the duration ends it; 0."""
    if "help" in config.fault:
        print(describe_faults())
        return 0
    if not config.channel:
        raise InputError("--channel: is not given, expected a channel such as vcan0 or udp_multicast:239.74.163.2")
    description = load_robot(config.robot)
    addresses = parse_addresses(config.channel)
    faults = [parse_fault(text, description) for text in config.fault]
    _refuse_unreachable(addresses, faults)
    if config.duration is not None and not (math.isfinite(config.duration) and config.duration > 0.0):
        raise InputError(f"--duration: is {config.duration}, expected a finite number above 0")
    if config.midi is not None and description.piano is None:
        raise InputError(f"--midi: is '{config.midi}', but {description.name} has no piano; lite_piano has one")
    news: SimpleQueue[str] = SimpleQueue()  # printed here: the motors wait for no terminal
    ending = threading.Event()
    handlers = [(number, signal.signal(number, lambda *_: ending.set())) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        with punctual_threads(behind=10) as punctuality:
            motors = VirtualMotors(
                description,
                addresses,
                settings=_settings(config, description),
                faults=faults,
                told=None if config.quiet else lambda time, text: news.put(f"{time:9.3f} s  {text}"),
            )
        with motors, ExitStack() as keyboard:
            if config.midi is not None:
                keyboard.enter_context(closing(MidiKeyboard(config.midi, lambda: motors.truth.live[KEY_PRESSED])))
            channels = ", ".join(str(address) for address in addresses)
            who = f"the motor of {config.alone}, id {FACTORY_ID}," if config.alone else f"{len(motors.joints)} motors"
            print(f"{who} of {description.name} on {channels}; {punctuality}", flush=True)
            _wait(config, motors, HandSweep(description, motors.truth.joint_position), news, ending)
            for bus, address in enumerate(addresses):
                print(f"{address}: {motors.frames(bus)} frames")
            if motors.slipped:
                print(f"the motors stood still for {motors.slipped:.2f} s because this computer was too slow for them")
            if motors.send_errors:
                print(f"{motors.send_errors} frames of motors were not taken by their channel")
    finally:
        for number, handler in handlers:
            signal.signal(number, handler)
    return 0


def _wait(
    config: Emulate, motors: VirtualMotors, sweep: HandSweep, news: SimpleQueue[str], ending: threading.Event
) -> None:
    """Until the program is to end, or the emulation has failed, which closing it raises."""
    begin, limit = motors.time, math.inf if config.duration is None else config.duration
    while motors.failure is None and motors.time < limit and not ending.wait(_WAKE):
        if config.sweep:
            motors.move_by_hand(sweep.at(motors.time - begin))
        _print_all(news)
    _print_all(news)


def _print_all(news: SimpleQueue[str]) -> None:
    while not news.empty():
        print(news.get(), flush=True)


def _refuse_unreachable(addresses: Sequence[BusAddress], faults: Sequence[Fault]) -> None:
    """Refuse what this process cannot reach: channels within another one, and its end of a channel."""
    for address in addresses:
        if address.interface == "virtual":
            raise InputError(
                f"--channel: is '{address}', which no other process can reach; expected a CAN interface such as "
                "vcan0, or udp_multicast:239.74.163.2"
            )
    for fault in faults:
        if fault.info.scope == "host":
            raise InputError(
                f"--fault: is '{fault}', which is made at the other program's end of the channel; expected a fault of "
                "the motors or the bus"
            )


def _settings(config: Emulate, description: RobotDescription) -> EmulationSettings:
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
        seed=config.seed,
        write_only=config.write_only,
        alone=config.alone,
    )


_LIFT_TIME = 2.0
"""s"""
_TIME_PER_JOINT = 4.0
"""s to one limit, to the other, and back."""
_BEYOND = 0.05
"""rad beyond the limits, so that the joint reaches its stop."""


class HandSweep:
    """Lifts all joints to 0, then leads one after the other to its upper and its lower limit and back, again and again.

    At 0 the Lite stands as a T, where all joints but one have their whole range free. The raised arm hits the head
    before the shoulder's roll is at its stop: that joint needs an operator, who turns the arm past it.
    """

    def __init__(self, description: RobotDescription, position: FloatArray) -> None:
        """Take hold at the present positions, shape (n,), rad."""
        driven = [(i, joint) for i, joint in enumerate(description.joints) if joint.motor is not None]
        self._start = {joint.name: float(position[i]) for i, joint in driven}
        self._range = {joint.name: (joint.lower, joint.upper) for _, joint in driven}

    def at(self, time: float) -> Mapping[str, float]:
        """Return where the hand leads each joint, rad, `time` s after it took hold."""
        left = max(1.0 - time / _LIFT_TIME, 0.0)
        led = {name: left * start for name, start in self._start.items()}
        turn, phase = divmod(max(time - _LIFT_TIME, 0.0) / _TIME_PER_JOINT, 1.0)
        name = list(led)[int(turn) % len(led)]
        lower, upper = self._range[name]
        swing = math.sin(2.0 * math.pi * phase)
        led[name] += swing * (upper + _BEYOND if swing > 0.0 else _BEYOND - lower)
        return led
