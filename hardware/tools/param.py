"""`hardware ping` and `hardware param`: one Robstride motor's answers and parameters."""

from __future__ import annotations

import statistics
import time

from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError
from humanoid_sim.hardware.robstride.firmware import model_name, version_text
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, check_value, fault_word, find_parameter
from humanoid_sim.hardware.robstride.protocol import SAVE, DeviceId, FaultBit, FrameType, flag_names
from humanoid_sim.hardware.tools import bench
from humanoid_sim.hardware.tools.options import Get, Ping, Save, Set

_QUESTIONS = 10
_ANSWER_TIME = 1.0  # s; it takes a millisecond, and a busy computer may take longer to notice
_PINGED = ("run_mode", "mechPos", "mechVel", "VBUS", "limit_torque", "canTimeout")


def ping(config: Ping) -> int:
    """Ask, print, and return the exit status."""
    with bench.open_motor(config.channel, config.motor_id) as link:
        print(f"{link.motors.names[0]}, unique id {bench.ask_uid(link).hex()}")
        question, times = {0: [link.frame(0, FrameType.GET_DEVICE_ID)]}, []
        for _ in range(_QUESTIONS):
            begin = time.perf_counter()
            if link.ask(question, lambda _, reply: isinstance(reply, DeviceId) or None, (_ANSWER_TIME,)):
                times.append(1e3 * (time.perf_counter() - begin))
        summary = f"median {statistics.median(times):.2f} ms, max {max(times):.2f} ms" if times else "none came back"
        rows = {"answered": f"{len(times)} of {_QUESTIONS}, {summary}"}
        rows |= {name: bench.shown(PARAMETERS[name], bench.read_value(link, PARAMETERS[name])) for name in _PINGED}
        version = link.read_versions([0]).get(0)
        model = None if version is None else model_name(version)
        if version is not None and model is not None:
            word = bench.read_value(link, fault_word(model))
            rows["firmware"] = f"{version_text(version)} ({model})"
            rows["faults"] = "not there" if word is None else ", ".join(flag_names(FaultBit(int(word)))) or "none"
    for name, text in rows.items():
        print(f"  {name:<13} {text}")
    return 0


def param(config: Get | Set | Save) -> int:
    """Do it, print, and return the exit status."""
    match config:
        case Get():
            return _get(config)
        case Set():
            return _set(config)
    with bench.open_motor(config.channel, config.motor_id) as link:
        bench.command_motor(link, FrameType.SAVE_PARAMETERS, SAVE)
        print(f"{link.motors.names[0]}: saved")
    return 0


def _get(config: Get) -> int:
    parameters = [find_parameter(name) for name in config.names] or list(PARAMETERS.values())
    with bench.open_motor(config.channel, config.motor_id) as link:
        values = [bench.read_value(link, parameter) for parameter in parameters]
    rows = [
        (f"0x{known.index:04X}", known.name, bench.shown(known, value), known.meaning)
        for known, value in zip(parameters, values, strict=True)
    ]
    bench.make_console().print(bench.make_table(("index", "name", "value", ""), rows))
    return ExitStatus.FAILED if config.names and None in values else 0


def _set(config: Set) -> int:
    parameter = find_parameter(config.name)
    if not parameter.is_writable:
        raise InputError(f"{parameter.name}: is read only")
    check_value(parameter, config.value)
    with bench.open_motor(config.channel, config.motor_id) as link:
        before = bench.read_value(link, parameter)
        bench.write_value(link, parameter, config.value)
        after = bench.read_value(link, parameter)
        change = f"{bench.shown(parameter, before)} -> {bench.shown(parameter, after)}"
        print(f"{link.motors.names[0]}: {parameter.name} {change}, until power-off unless saved")
    return 0
