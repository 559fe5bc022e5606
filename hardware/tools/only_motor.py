"""`hardware set-id` and `set-zero`: lasting changes of one motor alone on a bus, as it is delivered.

On a robot with all its motors a wrong id would change the wrong one, and two with the factory's id would both obey. So
the motor is found, alone, and stopped before anything is changed.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from humanoid_sim.cli import complain
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.bus.address import parse_address
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.enabling import stop_motors
from humanoid_sim.hardware.robstride.firmware import model_name, version_text
from humanoid_sim.hardware.robstride.identification import read_versions
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, RunMode, default_value
from humanoid_sim.hardware.tools.bench import (
    SilentMotorError,
    ask_uid,
    command_motor,
    confirm,
    open_bench,
    read_value,
    require_up,
    shown,
    silence,
    some_motors,
)
from humanoid_sim.hardware.tools.options import SetId, SetZero

_QUIET = 0.2  # s without an answer after which no other is expected
_PACE = 0.002  # s between two ids: answers of motors that share an id come apart
_LISTENING = 0.1  # s of silence in which another host would be received
_SCANS = 2  # times that every id is asked: an answer may be lost, and two that collide may both be


@dataclass(frozen=True, slots=True)
class _OnlyMotor:
    """The motor, on a link that knows it."""

    link: RobstrideLink
    motor_id: int
    uid: bytes
    model: str | None
    """Such as rs-02; None if its firmware does not say."""


def _uids(link: RobstrideLink, ids: list[int], pace: float = 0.0) -> dict[int, set[bytes]]:
    """Return the unique ids that answer, by motor id."""
    found: dict[int, set[bytes]] = {}
    for _, reply in link.scan(ids, _QUIET, pace):
        found.setdefault(reply.motor_id, set()).add(reply.uid)
    return found


def _named(uids: dict[int, set[bytes]]) -> str:
    return ", ".join(f"{i} (unique id {uid.hex()})" for i, same in sorted(uids.items()) for uid in sorted(same))


@contextlib.contextmanager
def _only_motor(channel: str, host_id: int) -> Iterator[_OnlyMotor]:
    """Find the one motor on a channel, and stop it. Raises `RobotError` if it is not alone there."""
    address = parse_address(channel)
    with open_bench([address], host_id, some_motors([], [])) as link:
        source, ids = link.sources[0], list(range(1, LARGEST_MOTOR_ID + 1))
        uids: dict[int, set[bytes]] = {}
        for _ in range(_SCANS):
            for motor_id, same in _uids(link, ids, _PACE).items():
                uids.setdefault(motor_id, set()).update(same)
        require_up(link)
        if not uids:
            raise silence(link, 0, "no motor answers")
        count = sum(len(same) for same in uids.values())
        if count > 1:
            raise RobotError(f"{source}: {count} motors answer, expected one alone on the bus: {_named(uids)}")
        if troubles := link.line.troubles(0):
            raise RobotError(f"{source}: {troubles[0]}: two motors with one id, or bad wiring")
        ((motor_id, (uid,)),) = uids.items()
        link.expect(some_motors([(0, motor_id)], link.sources))
        _stop(link)
        version = read_versions(link, [0]).get(0)
        model = None if version is None else model_name(version)
        firmware = "unknown" if version is None else version_text(version)
        kind = f"{model or 'model unknown'}, firmware {firmware}"
        print(f"found motor {motor_id} on {source} ({kind}, unique id {uid.hex()}), and no other")
        yield _OnlyMotor(link, motor_id, uid, model)


def _stop(link: RobstrideLink) -> None:
    """Stop it, once it is clear that no other host speaks on the bus."""
    time.sleep(_LISTENING)
    if strangers := link.line.notes[0].strangers:
        received = ", ".join(f"{count} × {what}" for what, count in strangers.items())
        raise RobotError(f"{link.sources[0]}: received {received}, expected one motor alone")
    checks = CheckList()
    link.line.check(checks)
    checks.refuse()
    if stop_motors(link, [0]):
        raise SilentMotorError(f"{link.motors.names[0]}: does not confirm that it is stopped")


def _warn_of_saving(motor: _OnlyMotor) -> None:
    """Name the parameters that are not as delivered: saving keeps all values, these as well."""
    for parameter in PARAMETERS.values():
        usual = None if motor.model is None else default_value(parameter, motor.model)
        value = read_value(motor.link, parameter) if parameter.is_writable and usual is not None else None
        if value is not None and usual is not None and not parameter.is_same(value, usual):
            complain(
                f"warning: saving keeps {parameter.name} {shown(parameter, value)} too (factory: "
                f"{shown(parameter, usual)}); to avoid it, switch the motor off and on first"
            )


def _save(motor: _OnlyMotor) -> None:
    """Let the motor keep its values beyond power-off, and check that it is still the one that answers."""
    command_motor(motor.link, messages.SaveParameters(motor.motor_id, host_id=motor.link.host_id))
    if (uid := ask_uid(motor.link)) != motor.uid:
        raise RobotError(f"motor {motor.motor_id}: unique id {uid.hex()} answers, expected {motor.uid.hex()}")


_ATTEMPTS = 3  # times that the new id is sent: a lost frame leaves the motor at its old one


def set_id(config: SetId) -> int:
    """Ask for confirmation, set the id, verify it, save it, and return the exit status."""
    if not 1 <= config.new_id <= LARGEST_MOTOR_ID:
        raise InputError(f"new id: is {config.new_id}, expected 1 to {LARGEST_MOTOR_ID}")
    with _only_motor(config.channel, config.host_id) as motor:
        if motor.motor_id == config.new_id:
            print(f"it has the id {config.new_id} already: nothing was changed")
            return 0
        _warn_of_saving(motor)
        confirm(f"Give it the id {config.new_id}, now and beyond power-off?", config.yes, "the id was not changed")
        _save(_rename(motor, config.new_id))
        print(f"motor {motor.motor_id} is now {config.new_id}, read back and saved")
        print("Mark the motor. To see that it has kept its id, switch it off and on, then:")
        print(f"  python -m humanoid_sim.hardware ping {config.channel} {config.new_id}")
    return 0


def _rename(motor: _OnlyMotor, new_id: int) -> _OnlyMotor:
    """Return the motor under its new id, where it alone answers."""
    link, answers = motor.link, {motor.motor_id: {motor.uid}}
    for _ in range(_ATTEMPTS):
        if motor.motor_id not in answers:
            break
        link.send({0: [messages.SetDeviceId(motor.motor_id, new_id, host_id=link.host_id)]})
        answers = _uids(link, [motor.motor_id, new_id] * 2)
    if answers != {new_id: {motor.uid}}:
        now = _named(answers) or "no motor"
        raise RobotError(f"motor {motor.motor_id} did not become {new_id}: now answers {now}; run discover")
    link.expect(some_motors([(0, new_id)], link.sources))
    return replace(motor, motor_id=new_id)


_STILL = 0.01  # rad that the shaft may turn within `_STILL_TIME`; more, and somebody turns it
_STILL_TIME = 0.3  # s between two readings
_NEAR = 0.01  # rad from zero at which it counts as set


def set_zero(config: SetZero) -> int:
    """Ask for confirmation, set the zero, verify it, save it, and return the exit status."""
    with _only_motor(config.channel, config.host_id) as motor:
        _check(motor)
        before = _position(motor)
        _warn_of_saving(motor)
        print(f"its position is {before:.3f} rad; a calibration of its joint is void afterwards")
        confirm("Is the shaft where its zero shall be?", config.yes, "the zero was not changed")
        first = _position(motor)
        time.sleep(_STILL_TIME)
        if abs(_position(motor) - first) > _STILL:
            raise RobotError(f"motor {motor.motor_id}: its shaft turns: hold it still")
        command_motor(motor.link, messages.SetZero(motor.motor_id, host_id=motor.link.host_id))
        after = _position(motor)
        if not abs(after) <= _NEAR:
            raise RobotError(f"motor {motor.motor_id}: reads {after:.3f} rad after its zero was set, expected 0")
        _save(motor)
        print(f"its position was {before:.3f} rad and is now {after + 0.0:.3f}, read back and saved")
        print("To see that it has kept its zero, switch it off and on without turning it; then near 0 or 6.28:")
        print(f"  python -m humanoid_sim.hardware param get {config.channel} {motor.motor_id} mechPos")
    return 0


def _check(motor: _OnlyMotor) -> None:
    """Raise `RobotError` where the zero would not be set, or would not stay."""
    mode, offset = (read_value(motor.link, PARAMETERS[name]) for name in ("run_mode", "add_offset"))
    if mode != RunMode.OPERATION:
        raise RobotError(f"motor {motor.motor_id}: run_mode is {mode}, expected 0: in mode 1 the zero is ignored")
    if offset:
        raise RobotError(
            f"motor {motor.motor_id}: add_offset is {offset:g} rad, which moves its zero at the next power-on; set it "
            "to 0 and save first"
        )


def _position(motor: _OnlyMotor) -> float:
    position = read_value(motor.link, PARAMETERS["mechPos"])
    if position is None:
        raise RobotError(f"motor {motor.motor_id}: mechPos cannot be read")
    return position
