"""`hardware ping`: one motor's answers, and on request its state."""

from __future__ import annotations

import statistics
import time
from contextlib import nullcontext

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import parse_address
from humanoid_sim.hardware.robstride.firmware import firmware_of, model_name, version_text
from humanoid_sim.hardware.robstride.identification import read_versions
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.messages import DeviceId, FaultBit, GetDeviceId, flag_names
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, fault_word
from humanoid_sim.hardware.tools.bench import (
    Ear,
    SilentMotorError,
    motor_bench,
    no_question,
    open_bench,
    read_device_id,
    read_value,
    require_up,
    some_motors,
    title,
)
from humanoid_sim.hardware.tools.enabled_motor import EnabledMotor
from humanoid_sim.hardware.tools.options import Ping
from humanoid_sim.hardware.tools.terminal import shown
from humanoid_sim.robots.motors import FAMILIES, motor_model
from humanoid_sim.session.realtime import real_time

_ANSWER_TIME = 0.2
"""s; it takes a millisecond, and a busy computer may take longer to notice."""
_LISTENING = 1.0
"""s of listening for a motor that cannot be asked."""
_SHOWN = ("run_mode", "mechPos", "mechVel", "VBUS", "limit_torque", "canTimeout")


def ping(config: Ping) -> int:
    """Ask, print, and return the exit status."""
    if not 1 <= config.count <= 10_000:
        raise InputError(f"--count: is {config.count}, expected 1 to 10000")
    if config.model is not None:
        motor_model(config.model)
    if not FAMILIES[config.family].has_questions:
        return _listen(config)
    with (
        real_time() if config.read_status else nullcontext(),
        motor_bench(config.channel, config.motor_id, config.host_id) as channels,
    ):
        uid = read_device_id(channels).uid
        print(f"{channels.motors.names[0]}, unique id {uid.hex()}")
        _time_answers(channels, config)
        for name in _SHOWN:
            print(f"  {name:<13} {shown(PARAMETERS[name], read_value(channels, PARAMETERS[name]))}")
        if config.read_status:
            _read_status(channels, config)
    return 0


def _listen(config: Ping) -> int:
    """Listen for a motor that cannot be asked."""
    name, address = title(config.family), parse_address(config.channel)
    if config.read_status:
        raise InputError(f"--read-status: would enable a {name} motor, which only identify and calibrate do")
    with open_bench([address], config.host_id, some_motors([], [])) as channels:
        ear = Ear(config.family, channels)
        time.sleep(_LISTENING)
        require_up(channels)
        heard = ear.heard().get((0, config.motor_id))
    if heard is None:
        raise SilentMotorError(
            f"{name} motor {config.motor_id} sends no feedback on {address} within {_LISTENING:g} s: "
            f"{no_question(config.family)}"
        )
    print(f"{name} motor {config.motor_id} on {address} sends feedback: it is enabled. Nothing was sent")
    print(f"  frames        {heard.frames} in {_LISTENING:g} s")
    print(f"  position      {heard.position:.4f} rad")
    print(f"  velocity      {heard.velocity:.4f} rad/s")
    return 0


def _time_answers(channels: RobstrideLink, config: Ping) -> None:
    question = {0: [GetDeviceId(config.motor_id, host_id=config.host_id)]}
    times = []
    for _ in range(config.count):
        begin = time.perf_counter()
        if channels.ask(question, lambda _, reply: isinstance(reply, DeviceId) or None, (_ANSWER_TIME,)):
            times.append(1e3 * (time.perf_counter() - begin))
    summary = f"median {statistics.median(times):.2f} ms, max {max(times):.2f} ms" if times else "none came back"
    print(f"  answered      {len(times)} of {config.count}, {summary}")


def _read_status(channels: RobstrideLink, config: Ping) -> None:
    version = read_versions(channels, [0]).get(0)
    name = config.model or (None if version is None else model_name(version))
    if name is None:
        raise InputError("--model: is needed, the motor does not tell its firmware; expected such as rs-02")
    model = motor_model(name)
    if version is not None:
        model = firmware_of(model, version).applied_to(model)
        print(f"  firmware      {version_text(version)}")
    channels.expect(some_motors([(0, config.motor_id)], channels.sources, model))
    with EnabledMotor(channels) as motor:
        status = motor.command(0.0, 0.0, 0.0, 0.0)
    print(f"  model         {name}")
    print(f"  position      {status.position:.4f} rad")
    print(f"  velocity      {status.velocity:.4f} rad/s")
    print(f"  effort        {status.effort:.3f} N·m")
    print(f"  temperature   {status.temperature:.1f} °C")
    word = read_value(channels, fault_word(name))
    # The word shows overvoltage as well, which no status does.
    faults = flag_names(FaultBit(int(word))) if word is not None else flag_names(status.faults)
    print(f"  faults        {', '.join(faults) or 'none'}")
    print("  stopped again")
