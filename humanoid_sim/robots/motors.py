"""Motor models: ratings of the data sheets, the ranges that MIT frames can encode, traits of the protocol.

Ranges are from Actuator-Control, `src/protocol/robstride.rs` and `sito.rs` (T-K-233 and Berkeley-Humanoids, d74dd3f).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MotorModel:
    """One model. Ranges are full scale of its frames' fields, symmetric but for gains."""

    name: str  # in robot descriptions: `rs-02`
    family: str  # key of `FAMILIES`
    stiffness: float  # N·m/rad, range, from 0
    damping: float  # N·m·s/rad, range, from 0
    velocity: float  # rad/s, range; rs-03 and rs-04 can turn faster without load
    effort: float  # N·m, range
    peak_torque: float  # N·m
    peak_current: float  # A, phase, peak
    no_load_velocity: float = math.inf  # rad/s
    fault_temperature: float = math.inf  # °C, stops; the lower of the manuals' languages
    position: float = 4.0 * math.pi  # rad, range, of the manuals' tables; old firmware used 12.5


SITO_COUNTS_PER_RAD = 65536.0 / (2.0 * math.pi)  # of positions and velocities, at the output


def _sito(name: str, gear: int) -> MotorModel:
    # Ranges are its frames' integers: int16 velocity and current, int32 position. Gains are float32 without a range:
    # these are about the largest that were ever tried. No data sheet is public.
    largest = 2**15 - 1
    velocity, position = largest / SITO_COUNTS_PER_RAD, (2**31 - 1) / SITO_COUNTS_PER_RAD
    effort = largest * 0.00009 * gear
    return MotorModel(name, "sito", 500.0, 5.0, velocity, effort, effort, largest / 1000.0, position=position)


_MODELS = (
    # ranges of K_p, K_d, velocity, effort; peak torque and current, no-load velocity, fault °C
    MotorModel("rs-00", "robstride", 500.0, 5.0, 33.0, 14.0, 14.0, 15.5, 33.0, 145.0),
    MotorModel("rs-01", "robstride", 500.0, 5.0, 44.0, 17.0, 17.0, 23.0, 33.0, 103.0),
    MotorModel("rs-02", "robstride", 500.0, 5.0, 44.0, 17.0, 17.0, 23.0, 42.9, 135.0),
    MotorModel("rs-03", "robstride", 5000.0, 100.0, 20.0, 60.0, 60.0, 43.0, 20.9, 145.0),
    MotorModel("rs-04", "robstride", 5000.0, 100.0, 15.0, 120.0, 120.0, 90.0, 20.9, 145.0),
    MotorModel("rs-05", "robstride", 500.0, 5.0, 50.0, 5.5, 5.5, 11.0, 50.3, 135.0),
    MotorModel("rs-06", "robstride", 5000.0, 100.0, 50.0, 36.0, 36.0, 57.0, 50.3, 135.0),
    _sito("TA40-50", 51),
    _sito("TA40-100", 101),
)
MOTORS: Mapping[str, MotorModel] = {model.name: model for model in _MODELS}


@dataclass(frozen=True, slots=True)
class MotorFamily:
    """Traits of all motors of one protocol."""

    name: str
    ids: range  # ids that its frames can address
    last_bytes: frozenset[int] = frozenset()  # of its host's identifiers: no id of another family's motor
    has_timeout: bool = True  # its motors stop by themselves when their host falls silent
    has_torque_limit: bool = True  # its motors have a limit for torque and current
    has_questions: bool = False  # the bench tools can ask its motors who and where they are
    stiffness_doubt: float = 1.0  # largest ratio of a motor's K_p to the commanded one, where sources disagree
    damping_doubt: float = 1.0  # likewise of its K_d


_HOST_IDS = range(128, 256)  # Robstride's frames name their host in the byte where Sito's name the motor
FAMILIES: Mapping[str, MotorFamily] = {
    "robstride": MotorFamily("robstride", range(1, 128), has_questions=True),
    # Last bytes: reset, select mode, command, gains. Doubts: where the library of the protocol divides gains by 500
    # and 0.5 (`humanoid_sim.hardware.sito.protocol`), its authors' page on the Prime robot has 688.58 and 1.125.
    "sito": MotorFamily(
        "sito",
        ids=range(1, 256),
        last_bytes=frozenset({0x00, 0x01, 0x09, 0x45}),
        has_timeout=False,
        has_torque_limit=False,
        stiffness_doubt=688.58 / 500.0,
        damping_doubt=1.125 / 0.5,
    ),
}


def id_problem(family: MotorFamily, motor_id: int, families: Collection[str]) -> str:
    """Return why a motor must not have this id on a robot with motors of these families; '' if it may."""
    if motor_id not in family.ids:
        return f"is {motor_id}, expected {family.ids[0]} to {family.ids[-1]}"
    for other in (FAMILIES[name] for name in families if name != family.name):
        if motor_id in other.last_bytes:
            return f"is {motor_id}, which frames to {other.name} motors of this robot could address; expected another"
        if motor_id in _HOST_IDS:
            return f"is {motor_id}, expected 1 to 127 beside {other.name} motors"
    return ""
