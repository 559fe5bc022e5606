"""Settings of emulated motors and their buses."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from humanoid_sim.errors import InputError, known_names, require_known
from humanoid_sim.hardware.emulation.firmware import MotorIdentity
from humanoid_sim.hardware.robstride.firmware import emulated_version, firmware_of, parse_version
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import motor_model


@dataclass(frozen=True, slots=True)
class EmulationSettings:
    """Settings of the emulation that are not in the robot description. A number out of range is an `InputError`."""

    homing_offset: Mapping[str, float] = field(default_factory=dict)
    """rad, motor frame, by joint: the shaft's angle where the joint is at 0, as the motors are assembled; 0 for joints
    that are not named."""
    firmware: Mapping[str, str] = field(default_factory=dict)
    """Versions such as `0.2.3.5`, by joint or by model; the newest for motors that are not named."""
    stall_time: float = 2.0
    """s; see `MotorIdentity`."""
    room_temperature: float = 25.0
    """°C"""
    supply_voltage: float = 48.0
    """V"""
    physics_timestep: float | None = None
    """s, which is also the period of the motors' control loops; None: the description's."""
    support: bool = True
    """True if a floating base starts held."""
    base_yaw: float = 0.0
    """rad, of a floating base."""
    base_height: float | None = None
    """m, of a floating base; None: the description's."""
    anchor_body: str = ""
    """MJCF body whose pose is part of the truth; empty for none."""
    write_only: bool = False
    """See `MotorIdentity`."""
    alone: str = ""
    """Joint whose motor is alone on the bus, as it comes from the factory; empty: all are there, with their ids."""
    deaf_until_enabled: bool = False
    """True if a motor without a timeout, such as a Sito, ignores gains and commands while it is disabled, which is not
    known: it then starts with those of its last host."""
    seed: int = 0
    """Seed of the random faults, and of the motors' unique ids."""

    def __post_init__(self) -> None:
        for name, lowest in (("stall_time", 0.0), ("supply_voltage", 0.0)):
            value = getattr(self, name)
            if math.isnan(value) or value < lowest or (math.isinf(value) and name != "stall_time"):
                raise InputError(f"{name}: is {value}, expected a finite number >= {lowest:g}")


def motor_identities(description: RobotDescription, settings: EmulationSettings) -> tuple[MotorIdentity, ...]:
    """One motor per joint that a Robstride drives, in order, with the firmware that the settings give it.

    Raises `InputError` if a firmware is given for what the robot has not, or is not a version of that model; or the
    motor that is to be alone is none.
    """
    driven = {joint.name: joint.motor for joint in description.joints if joint.motor is not None}
    motors = {name: motor for name, motor in driven.items() if motor_model(motor.model).family == "robstride"}
    if settings.alone and settings.alone not in motors:
        raise InputError(known_names("joint with a Robstride motor", settings.alone, motors))
    known = [*motors, *dict.fromkeys(motor.model for motor in motors.values())]
    require_known("joint or motor model", settings.firmware, known, "firmware: ")
    identities = []
    for name, motor in motors.items():
        model = motor_model(motor.model)
        text = settings.firmware.get(name, settings.firmware.get(motor.model))
        newest = emulated_version(model)
        version = newest if text is None else parse_version(text)
        if version[1] != newest[1]:
            raise InputError(f"firmware of {name}: is {text}, expected 0.{newest[1]}.x.x for the {motor.model}")
        firmware = firmware_of(model, version)
        uid = hashlib.sha256(f"{description.name}/{name}/{settings.seed}".encode()).digest()[:8]
        habits = settings.stall_time, settings.write_only
        identities.append(MotorIdentity(firmware.applied_to(model), uid, version, firmware, *habits))
    return tuple(identities)
