"""`hardware param`: one motor's parameters."""

from __future__ import annotations

from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError
from humanoid_sim.hardware.robstride.firmware import model_name
from humanoid_sim.hardware.robstride.identification import read_versions
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.messages import MotorMode, SaveParameters
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    Parameter,
    ParameterType,
    check_value,
    depends_on_model,
    find_parameter,
    function_codes,
    is_function_code,
)
from humanoid_sim.hardware.tools.bench import command_motor, motor_bench, read_value, write_value
from humanoid_sim.hardware.tools.options import Get, Param, Save, Set
from humanoid_sim.hardware.tools.terminal import make_console, make_table, shown
from humanoid_sim.robots.motors import MotorModel, motor_model

_LARGEST_INDEX = 0xFFFF


def param(options: Param) -> int:
    """Do it, print, and return the exit status."""
    config = options.command
    match config:
        case Get():
            return _get(config)
        case Set():
            return _set(config)
        case Save():
            return _save(config)


def _parameter(text: str, kind: str | None) -> Parameter:
    """Return a parameter by name or index; an index without a name needs a type."""
    try:
        known = find_parameter(text)
    except InputError as error:
        try:
            index = int(text, 0)
        except ValueError:
            raise error from None
        if not 0 <= index <= _LARGEST_INDEX:
            raise InputError(f"parameter: is {text}, expected an index of 0 to 0xFFFF or a name") from None
        if kind is None:
            raise InputError(f"--type: is needed for {text}, which has no name here; expected such as f32") from None
        return Parameter(index, f"0x{index:04X}", ParameterType[kind.upper()])
    if kind is not None and ParameterType[kind.upper()] is not known.type:
        raise InputError(f"--type: is {kind}, {known.name} is a {known.type.name.lower()}")
    return known


def _get(config: Get) -> int:
    parameters = [_parameter(name, config.type) for name in config.names] or list(PARAMETERS.values())
    with motor_bench(config.channel, config.motor_id, config.host_id) as channels:
        values = [read_value(channels, parameter) for parameter in parameters]
    table = make_table("index", "name", "value", "", title=channels.motors.names[0])
    for parameter, value in zip(parameters, values, strict=True):
        note = parameter.meaning if parameter.is_writable else f"{parameter.meaning} (read only)".strip()
        table.add_row(f"0x{parameter.index:04X}", parameter.name, shown(parameter, value), note)
    make_console().print(table)
    return ExitStatus.FAILED if config.names and None in values else 0


def _set(config: Set) -> int:
    parameter = _parameter(config.name, config.type)
    known = None if config.model is None else motor_model(config.model)
    _check(parameter, config.value, known)
    with motor_bench(config.channel, config.motor_id, config.host_id) as channels:
        before = read_value(channels, parameter)
        if known is None and (depends_on_model(parameter) or is_function_code(parameter.index)):
            _check(parameter, config.value, _model(channels, parameter))
        write_value(channels, parameter, config.value)
        after = read_value(channels, parameter)
        sample = channels.slots[0].sample  # what the write was answered with
    change = f"{shown(parameter, before)} -> {shown(parameter, after)}"
    print(f"{channels.motors.names[0]}: {parameter.name} {change}, until power-off unless saved")
    if sample is not None and sample.status.mode is MotorMode.RUN:
        print(f"motor {config.motor_id} is enabled")
    return 0


def _check(parameter: Parameter, value: float, model: MotorModel | None) -> None:
    """Refuse what the documents do not allow to be written; of an index without a name, what it is in this model."""
    code = None if model is None else function_codes(model.name).get(parameter.index)
    if code is not None and model is not None:
        if not code.is_writable:
            raise InputError(f"0x{code.index:04X}: is {code.name} of an {model.name}, which is read only")
        if parameter.type is not code.type:
            raise InputError(f"--type: is {parameter.type.name.lower()}, {code.name} is a {code.type.name.lower()}")
        parameter = code
    if not parameter.is_writable:
        raise InputError(f"{parameter.name}: is read only")
    check_value(parameter, value, model)


def _model(channels: RobstrideLink, parameter: Parameter) -> MotorModel:
    """Return the motor's model, as its firmware's version tells."""
    version = read_versions(channels, [0]).get(0)
    name = None if version is None else model_name(version)
    if name is None:
        raise InputError(f"--model: is needed for {parameter.name}, as the motor does not tell its own; such as rs-02")
    return motor_model(name)


def _save(config: Save) -> int:
    with motor_bench(config.channel, config.motor_id, config.host_id) as channels:
        command_motor(channels, SaveParameters(config.motor_id, host_id=config.host_id))
    print(f"{channels.motors.names[0]}: saved")
    return 0
