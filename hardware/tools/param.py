"""`hardware ping` and `hardware param`: one Robstride motor's answers and parameters."""

from __future__ import annotations

import statistics
import time

from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError
from humanoid_sim.hardware.robstride.firmware import model_name, version_text
from humanoid_sim.hardware.robstride.identification import read_versions
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.messages import DeviceId, FaultBit, GetDeviceId, SaveParameters, flag_names
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    Parameter,
    ParameterType,
    check_value,
    depends_on_model,
    fault_word,
    find_parameter,
)
from humanoid_sim.hardware.tools.bench import (
    ask_uid,
    command_motor,
    make_console,
    make_table,
    open_motor,
    read_value,
    shown,
    write_value,
)
from humanoid_sim.hardware.tools.options import Get, Param, Ping, Save, Set
from humanoid_sim.robots.motors import MotorModel, motor_model

_ANSWER_TIME = 0.2  # s; it takes a millisecond, and a busy computer may take longer to notice
_PINGED = ("run_mode", "mechPos", "mechVel", "VBUS", "limit_torque", "canTimeout")


def ping(config: Ping) -> int:
    """Ask, print, and return the exit status."""
    if not 1 <= config.count <= 10_000:
        raise InputError(f"--count: is {config.count}, expected 1 to 10000")
    with open_motor(config.channel, config.motor_id, config.host_id) as link:
        print(f"{link.motors.names[0]}, unique id {ask_uid(link).hex()}")
        question, times = {0: [GetDeviceId(config.motor_id, host_id=config.host_id)]}, []
        for _ in range(config.count):
            begin = time.perf_counter()
            if link.ask(question, lambda _, reply: isinstance(reply, DeviceId) or None, (_ANSWER_TIME,)):
                times.append(1e3 * (time.perf_counter() - begin))
        summary = f"median {statistics.median(times):.2f} ms, max {max(times):.2f} ms" if times else "none came back"
        print(f"  {'answered':<13} {len(times)} of {config.count}, {summary}")
        for name in _PINGED:
            print(f"  {name:<13} {shown(PARAMETERS[name], read_value(link, PARAMETERS[name]))}")
        version = read_versions(link, [0]).get(0)
        model = None if version is None else model_name(version)
        if version is not None and model is not None:
            print(f"  {'firmware':<13} {version_text(version)} ({model})")
            word = read_value(link, fault_word(model))
            print(f"  {'faults':<13} {'not there' if word is None else _names(word)}")
    return 0


def _names(word: float) -> str:
    return ", ".join(flag_names(FaultBit(int(word)))) or "none"


def param(options: Param) -> int:
    """Do it, print, and return the exit status."""
    match options.command:
        case Get() as get:
            return _get(get)
        case Set() as to_set:
            return _set(to_set)
        case Save() as save:
            with open_motor(save.channel, save.motor_id, save.host_id) as link:
                command_motor(link, SaveParameters(save.motor_id, host_id=save.host_id))
                print(f"{link.motors.names[0]}: saved")
            return 0


def _parameter(text: str, kind: str | None) -> Parameter:
    """Return a parameter by name or index; an index without a name needs a type."""
    try:
        known = find_parameter(text)
    except InputError as error:
        if kind is None or not text.lower().startswith("0x") or len(text) > len("0xFFFF"):
            raise InputError(f"{error}; an index such as 0x3022 needs --type") from None
        try:
            index = int(text, 16)
        except ValueError:
            raise error from None
        return Parameter(index, f"0x{index:04X}", ParameterType[kind.upper()])
    if kind is not None and ParameterType[kind.upper()] is not known.type:
        raise InputError(f"--type: is {kind}, {known.name} is a {known.type.name.lower()}")
    return known


def _get(config: Get) -> int:
    parameters = [_parameter(name, config.type) for name in config.names] or list(PARAMETERS.values())
    with open_motor(config.channel, config.motor_id, config.host_id) as link:
        values = [read_value(link, parameter) for parameter in parameters]
    table = make_table("index", "name", "value", "")
    for parameter, value in zip(parameters, values, strict=True):
        note = parameter.meaning if parameter.is_writable else f"{parameter.meaning} (read only)".strip()
        table.add_row(f"0x{parameter.index:04X}", parameter.name, shown(parameter, value), note)
    make_console().print(table)
    return ExitStatus.FAILED if config.names and None in values else 0


def _set(config: Set) -> int:
    parameter = _parameter(config.name, config.type)
    if not parameter.is_writable:
        raise InputError(f"{parameter.name}: is read only")
    check_value(parameter, config.value)
    with open_motor(config.channel, config.motor_id, config.host_id) as link:
        before = read_value(link, parameter)
        if depends_on_model(parameter):
            check_value(parameter, config.value, _model(link, parameter))
        write_value(link, parameter, config.value)
        after = read_value(link, parameter)
        change = f"{shown(parameter, before)} -> {shown(parameter, after)}"
        print(f"{link.motors.names[0]}: {parameter.name} {change}, until power-off unless saved")
        if link.slots[0].runs:  # the write was answered by a status
            print(f"motor {config.motor_id} is enabled")
    return 0


def _model(link: RobstrideLink, parameter: Parameter) -> MotorModel:
    version = read_versions(link, [0]).get(0)
    name = None if version is None else model_name(version)
    if name is None:
        raise InputError(f"{parameter.name}: its range is the model's, and the motor does not report its own")
    return motor_model(name)
