"""`hardware set-id` and `set-zero`: what lasts, for one motor alone on a bus, as it comes from the factory.

It is found, stopped and known before anything is changed.

On a robot with all its motors a wrong id would change the wrong one, and two motors that share the factory's id would
both obey.
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
    command_motor,
    nobody,
    open_bench,
    read_device_id,
    read_value,
    require_up,
    some_motors,
)
from humanoid_sim.hardware.tools.options import SetId, SetZero
from humanoid_sim.hardware.tools.terminal import confirm, shown

_QUIET = 0.2
"""s without an answer after which nobody else is expected."""
_PACE = 0.002
"""s between two ids: answers of motors that share an id come apart."""
_LISTENING = 0.1
"""s of silence in which others would be heard."""
_LOOKS = 2
"""Times that every id is asked: an answer may be lost, and two that collide may both be."""


@dataclass(frozen=True, slots=True)
class OnlyMotor:
    """The motor, with channels that know it."""

    channels: RobstrideLink
    motor_id: int
    uid: bytes
    model: str | None
    """Such as rs-02; none if its firmware does not tell."""
    firmware: str
    """Such as `0.2.3.6`, or `unknown`."""

    def __str__(self) -> str:
        """As an operator is told of it."""
        kind = f"{self.model or 'model unknown'}, firmware {self.firmware}"
        return f"motor {self.motor_id} on {self.channels.sources[0]} ({kind}, unique id {self.uid.hex()})"


@contextlib.contextmanager
def only_motor(channel: str, host_id: int) -> Iterator[OnlyMotor]:
    """Find the one motor on a channel and stop it.

    Raises:
        SilentMotorError: nobody answers, or the motor does not confirm that it is stopped.
        RobotError: several motors answer, somebody else speaks on the bus, or the channel cannot be used.
    """
    address = parse_address(channel)
    with open_bench([address], host_id, some_motors([], [])) as channels:
        uids: dict[int, set[bytes]] = {}
        for _ in range(_LOOKS):
            for _, reply in channels.scan(range(1, LARGEST_MOTOR_ID + 1), _QUIET, _PACE):
                uids.setdefault(reply.motor_id, set()).add(reply.uid)
        require_up(channels)
        motor_id, uid = _only(channels, uids)
        channels.expect(some_motors([(0, motor_id)], channels.sources))
        _stop(channels)
        version = read_versions(channels, [0]).get(0)
        model = None if version is None else model_name(version)
        yield OnlyMotor(channels, motor_id, uid, model, "unknown" if version is None else version_text(version))


def _only(channels: RobstrideLink, uids: dict[int, set[bytes]]) -> tuple[int, bytes]:
    """Id and unique id of the one that answered."""
    source, troubles = channels.sources[0], channels.line.troubles(0)
    if not uids:
        raise nobody(channels, 0)
    found = sorted((motor_id, uid) for motor_id, same in uids.items() for uid in same)
    if len(found) > 1:
        told = ", ".join(f"{motor_id} (unique id {uid.hex()})" for motor_id, uid in found)
        raise RobotError(f"{source}: {len(found)} motors answer, expected one alone on the bus: {told}")
    if troubles or channels.channels[0].counters.bus_errors:
        because = f" ({troubles[0]})" if troubles else ""
        raise RobotError(f"{source}: the bus has errors{because}: two motors with one id, or bad wiring")
    return found[0]


def _stop(channels: RobstrideLink) -> None:
    """Stop it, once it is clear that nobody else speaks on the bus."""
    time.sleep(_LISTENING)
    strangers = channels.line.notes[0].strangers
    if strangers:
        told = ", ".join(f"{count} × {what}" for what, count in strangers.items())
        raise RobotError(f"{channels.sources[0]}: somebody else speaks there ({told}), expected one motor alone")
    checks = CheckList()
    channels.line.check(checks)
    checks.refuse()
    if stop_motors(channels, [0]):
        raise SilentMotorError(f"{channels.motors.names[0]}: does not confirm that it is stopped")


def _warn_of_saving(motor: OnlyMotor) -> None:
    """Tell which parameters are not as they come from the factory: saving keeps all values, these as well."""
    if motor.model is None:
        complain("warning: its model is not known: saving keeps all values that it has now, whatever they are")
        return
    for parameter in PARAMETERS.values():
        usual = default_value(parameter, motor.model)
        if not parameter.is_writable or usual is None:
            continue
        value = read_value(motor.channels, parameter)
        if value is not None and not parameter.is_same(value, usual):
            complain(
                f"warning: saving keeps {parameter.name} {shown(parameter, value)} too (factory: "
                f"{shown(parameter, usual)}); to avoid it, switch the motor off and on first"
            )


def _save(motor: OnlyMotor) -> None:
    """Have the motor keep what it has beyond power-off; a `RobotError` if another one answers afterwards."""
    command_motor(motor.channels, messages.SaveParameters(motor.motor_id, host_id=motor.channels.host_id))
    uid = read_device_id(motor.channels).uid
    if uid != motor.uid:
        raise RobotError(f"motor {motor.motor_id}: unique id {uid.hex()} answers, expected {motor.uid.hex()}")


_ATTEMPTS = 3
"""Times that the new id is sent: a lost frame leaves the motor at its old one."""


def set_id(config: SetId) -> int:
    """Ask for confirmation, set the id, verify it, save it, and return the exit status."""
    if not 1 <= config.new_id <= LARGEST_MOTOR_ID:
        raise InputError(f"new id: is {config.new_id}, expected 1 to {LARGEST_MOTOR_ID}")
    with only_motor(config.channel, config.host_id) as motor:
        print(f"found {motor}, and nobody else")
        if motor.motor_id == config.new_id:
            print(f"it has the id {config.new_id} already: nothing was changed")
            return 0
        _warn_of_saving(motor)
        confirm(f"Give it the id {config.new_id}, now and beyond power-off?", config.yes, "the id was not changed")
        renamed = _rename(motor, config.new_id)
        _save(renamed)
        print(f"motor {motor.motor_id} is now {config.new_id}, read back and saved")
        print("Mark the motor. To see that it has kept its id, switch it off and on, then:")
        print(f"  python -m humanoid_sim.hardware ping {config.channel} {config.new_id}")
    return 0


def _rename(motor: OnlyMotor, new_id: int) -> OnlyMotor:
    """Return the motor under its new id, where it and nobody else answers."""
    channels = motor.channels
    answers: dict[int, set[bytes]] = {}
    for _ in range(_ATTEMPTS):
        channels.send({0: [messages.SetDeviceId(motor.motor_id, new_id, host_id=channels.host_id)]})
        answers = {}
        for _, reply in channels.scan([motor.motor_id, new_id, motor.motor_id, new_id], _QUIET):
            answers.setdefault(reply.motor_id, set()).add(reply.uid)
        if motor.motor_id not in answers:
            break
    if answers != {new_id: {motor.uid}}:
        told = ", ".join(f"{i} (unique id {uid.hex()})" for i, same in sorted(answers.items()) for uid in same)
        raise RobotError(
            f"motor {motor.motor_id} did not become {new_id}: now answers {told or 'nobody'}; "
            "run python -m humanoid_sim.hardware discover"
        )
    channels.expect(some_motors([(0, new_id)], channels.sources))
    return replace(motor, motor_id=new_id)


_STILL = 0.01
"""rad that the shaft may turn while it is looked at: more, and somebody turns it."""
_NEAR = 0.01
"""rad from zero at which it counts as set."""
_LOOK = 0.3
"""s between two readings."""


def set_zero(config: SetZero) -> int:
    """Ask for confirmation, set the zero, verify it, save it, and return the exit status."""
    with only_motor(config.channel, config.host_id) as motor:
        print(f"found {motor}, and nobody else")
        _check(motor)
        before = _position(motor)
        _warn_of_saving(motor)
        print(f"its position is {before:.3f} rad; a calibration of its joint is void afterwards")
        confirm("Is the shaft where its zero shall be?", config.yes, "the zero was not changed")
        _require_still(motor)
        command_motor(motor.channels, messages.SetZero(motor.motor_id, host_id=motor.channels.host_id))
        after = _position(motor)
        if not abs(after) <= _NEAR:
            raise RobotError(f"motor {motor.motor_id}: reads {after:.3f} rad after its zero was set, expected 0")
        _save(motor)
        print(f"its position was {before:.3f} rad and is now {round(after, 3) + 0.0:.3f}, read back and saved")
        print("To see that it has kept its zero, switch it off and on without turning it, then:")
        print(
            f"  python -m humanoid_sim.hardware param get {config.channel} {motor.motor_id} mechPos  # near 0 or 6.28"
        )
    return 0


def _check(motor: OnlyMotor) -> None:
    """Refuse where the zero would not be set, or would not stay where it is set."""
    mode = read_value(motor.channels, PARAMETERS["run_mode"])
    if mode != RunMode.OPERATION:
        told = "not told" if mode is None else f"{mode:g}"
        raise RobotError(f"motor {motor.motor_id}: run_mode is {told}, expected 0: in mode 1 the zero is ignored")
    offset = read_value(motor.channels, PARAMETERS["add_offset"])
    if offset:
        raise RobotError(
            f"motor {motor.motor_id}: add_offset is {offset:g} rad, which moves its zero at the next power-on; set it "
            "to 0 and save first"
        )


def _position(motor: OnlyMotor) -> float:
    position = read_value(motor.channels, PARAMETERS["mechPos"])
    if position is None:
        raise RobotError(f"motor {motor.motor_id}: mechPos cannot be read")
    return position


def _require_still(motor: OnlyMotor) -> None:
    first = _position(motor)
    time.sleep(_LOOK)
    if abs(_position(motor) - first) > _STILL:
        raise RobotError(f"motor {motor.motor_id}: its shaft turns: hold it still")
