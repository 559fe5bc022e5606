"""`hardware discover`, `ping`, `param`, `set-id` and `set-zero`: questions to Robstride motors, and lasting changes."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.can_bus import parse_address, parse_addresses
from humanoid_sim.hardware.joints import make_wiring
from humanoid_sim.hardware.robstride import parameters
from humanoid_sim.hardware.robstride.firmware import model_name, version_text
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, Parameter, find_parameter
from humanoid_sim.hardware.robstride.protocol import HERE, SAVE, FaultBit, FrameType, encode_command, flag_names
from humanoid_sim.hardware.tools import bench
from humanoid_sim.hardware.tools.bench import EVERY_ID, answer_of
from humanoid_sim.hardware.tools.options import Discover, Param, Ping, SetId, SetZero
from humanoid_sim.robots.description import load_robot

_PACE = 0.002  # s between two ids: answers of motors that share an id come apart
_QUIET = 0.3  # s without an answer after which no other is expected
_NEAR = 0.01  # rad from zero at which it counts as set
_PINGED = ("run_mode", "mechPos", "mechVel", "VBUS", "limit_torque", "canTimeout")
_POSITION = PARAMETERS["mechPos"]


def discover(config: Discover) -> int:
    """Scan, print, and return the exit status."""
    bench.check_id("--last", config.last)
    addresses = parse_addresses(config.channels)
    wiring = None if config.robot is None else make_wiring(load_robot(config.robot), len(addresses))
    with bench.open_bench(addresses) as link:
        answers = link.scan([one for one in EVERY_ID if one <= config.last], _QUIET, _PACE)
        found = sorted({(channel, reply.motor_id, reply.uid.hex()) for channel, reply in answers})
        for channel in range(len(addresses)):
            if channel in {one for one, *_ in found}:
                bench.warn_of_troubles(link, channel)
            else:
                complain(str(bench.silence(link, channel, "no motor answers")))
    there = {(motor_id, channel): addresses[channel] for channel, motor_id, _ in found}
    joints, missing = {}, []
    if wiring is not None:
        joints = {(motor.channel, motor.motor_id): motor.name for motor in wiring.motors}
        for i, ((channel, motor_id), name) in enumerate(joints.items()):
            if (motor_id, channel) not in there and i not in wiring.unasked:
                elsewhere = [f"; one is on {other}" for (one, _), other in there.items() if one == motor_id]
                missing.append(f"{name} (motor {motor_id} on {addresses[channel]}{''.join(elsewhere)})")
    if found:
        rows = [
            (str(addresses[channel]), str(motor_id), uid, joints.get((channel, motor_id), ""))
            for channel, motor_id, uid in found
        ]
        bench.make_console().print(bench.make_table(("channel", "id", "unique id", "joint"), rows))
    if missing:
        complain(f"missing: {', '.join(missing)}")
    if not found:
        return ExitStatus.NO_ANSWER
    return ExitStatus.of(not missing)


@contextlib.contextmanager
def _one_motor(config: Ping | Param) -> Iterator[tuple[RobstrideLink, int]]:
    """Open the channel of a motor of any model; gives the motor's index."""
    bench.check_id("motor id", config.motor_id)
    with bench.open_bench([parse_address(config.channel)]) as link:
        yield link, EVERY_ID.index(config.motor_id)
        bench.warn_of_troubles(link, 0)


def _command(link: RobstrideLink, motor: int, kind: FrameType, data: bytes) -> None:
    """Send a command that is answered by a status."""
    answer_of(link, motor, link.until_status({motor: [link.frame(motor, kind, data)]}, lambda _: True))


def _value(link: RobstrideLink, motor: int, parameter: Parameter) -> float:
    return answer_of(link, motor, link.read(parameter, [motor]))


def _shown(parameter: Parameter, value: float) -> str:
    if math.isnan(value):
        return "not there"
    if parameter.name == "canTimeout":
        return f"{int(value)} ({1000.0 * parameters.CAN_TIMEOUT_TICK * value:g} ms)" if value else "0 (off)"
    return f"{value:g} {parameter.unit}".rstrip() if parameter.is_float else str(int(value))


def ping(config: Ping) -> int:
    """Ask, print, and return the exit status."""
    with _one_motor(config) as (link, motor):
        print(f"{link.motors[motor].name}, unique id {answer_of(link, motor, link.read_uids([motor])).hex()}")
        rows = {name: _shown(PARAMETERS[name], _value(link, motor, PARAMETERS[name])) for name in _PINGED}
        version = link.read_versions([motor]).get(motor)
        model = None if version is None else model_name(version)
        if version is not None:
            rows["firmware"] = f"{version_text(version)} ({model or 'of no known model'})"
        if model is not None:
            word = _value(link, motor, parameters.fault_word(model))
            rows["faults"] = "not there" if math.isnan(word) else ", ".join(flag_names(FaultBit(int(word)))) or "none"
    for name, text in rows.items():
        print(f"  {name:<13} {text}")
    return 0


def param(config: Param) -> int:
    """Read, write or save parameters, print, and return the exit status."""
    chosen = [find_parameter(name) for name in config.names] or list(PARAMETERS.values())
    if config.value is not None:
        if len(config.names) != 1:
            raise InputError(f"--value: {len(config.names)} parameters are named, expected one")
        if not chosen[0].is_writable:
            raise InputError(f"{chosen[0].name}: is read only")
        parameters.check_value(chosen[0], config.value)
    with _one_motor(config) as (link, motor):
        if config.value is not None:
            answer_of(link, motor, link.write(chosen[0], {motor: config.value}))
        values = [_value(link, motor, parameter) for parameter in chosen]
        if config.save:
            _command(link, motor, FrameType.SAVE_PARAMETERS, SAVE)
    rows = [
        (f"0x{known.index:04X}", known.name, _shown(known, value), known.meaning)
        for known, value in zip(chosen, values, strict=True)
    ]
    bench.make_console().print(bench.make_table(("index", "name", "value", ""), rows))
    if config.value is not None and not chosen[0].is_same(values[0], config.value):
        raise RobotError(f"{chosen[0].name}: reads {values[0]} after {config.value:g} was written")
    return ExitStatus.of(not config.names or not any(map(math.isnan, values)))


@contextlib.contextmanager
def _only_motor(channel: str) -> Iterator[tuple[RobstrideLink, int, bytes]]:
    """Find the one motor on a channel, as delivered, and stop it; gives its id and unique id.

    On a robot with all its motors a wrong id would change the wrong one, and two with the factory's id would both obey.
    """
    with bench.open_bench([parse_address(channel)]) as link:
        source = link.sources[0]
        answers = link.scan([*EVERY_ID, *EVERY_ID], _QUIET, _PACE)  # twice: of two that collide both may be lost
        found = sorted({(reply.motor_id, reply.uid) for _, reply in answers})
        bench.check_channels(link)
        if not found:
            raise bench.silence(link, 0, "no motor answers")
        if len(found) > 1:
            names = ", ".join(f"{motor_id} (unique id {uid.hex()})" for motor_id, uid in found)
            raise RobotError(f"{source}: {len(found)} motors answer, expected one alone on the bus: {names}")
        if troubles := link.line.channels[0].troubles():
            raise RobotError(f"{source}: {'; '.join(troubles)}: expected one motor alone, and no other host")
        ((motor_id, uid),) = found
        if link.stop_motors([EVERY_ID.index(motor_id)]):
            raise bench.SilentMotorError(f"motor {motor_id} on {source}: does not confirm that it is stopped")
        print(f"found motor {motor_id} on {source}, unique id {uid.hex()}, and no other")
        yield link, motor_id, uid


def set_id(config: SetId) -> int:
    """Ask for confirmation, set the id, verify it, save it, and return the exit status."""
    new_id = config.new_id
    bench.check_id("new id", new_id)
    with _only_motor(config.channel) as (link, old_id, uid):
        if old_id == new_id:
            print(f"it has the id {new_id} already: nothing was changed")
            return 0
        bench.confirm(f"Give it the id {new_id}, now and beyond power-off?", config.yes, "the id was not changed")
        link.send({EVERY_ID.index(old_id): [encode_command(FrameType.SET_DEVICE_ID, old_id, high=new_id)]})
        found = {(reply.motor_id, reply.uid) for _, reply in link.scan([old_id, new_id] * 2, _QUIET, _PACE)}
        if found != {(new_id, uid)}:
            ids = ", ".join(str(motor_id) for motor_id, _ in sorted(found)) or "none"
            raise RobotError(f"motor {old_id} did not become {new_id}: ids that answer now: {ids}")
        _command(link, EVERY_ID.index(new_id), FrameType.SAVE_PARAMETERS, SAVE)
        print(f"motor {old_id} is now {new_id}, read back and saved")
    return 0


def set_zero(config: SetZero) -> int:
    """Ask for confirmation, set the zero, verify it, save it, and return the exit status."""
    with _only_motor(config.channel) as (link, motor_id, _):
        motor = EVERY_ID.index(motor_id)
        before = _value(link, motor, _POSITION)
        print(f"its position is {before:.3f} rad; a calibration of its joint is void afterwards")
        bench.confirm("Is the shaft where its zero shall be?", config.yes, "the zero was not changed")
        _command(link, motor, FrameType.SET_ZERO, HERE)
        after = _value(link, motor, _POSITION)
        if not abs(after) <= _NEAR:
            raise RobotError(f"motor {motor_id}: reads {after} rad after its zero was set, expected 0: hold it still")
        _command(link, motor, FrameType.SAVE_PARAMETERS, SAVE)
        print(f"its position is now {after:.3f} rad, read back and saved")
    return 0
