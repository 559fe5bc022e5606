"""`hardware ping`: one motor's answers, and on request its state."""

from __future__ import annotations

import statistics
import time

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.cli.client import MotorClient, open_client
from humanoid_sim.hardware.cli.enabled_motor import EnabledMotor
from humanoid_sim.hardware.cli.exchange import read_device_id, read_value, read_version, shown
from humanoid_sim.hardware.cli.options import Ping
from humanoid_sim.hardware.robstride.faults import FaultBit, flag_names
from humanoid_sim.hardware.robstride.firmware import firmware_of, model_name, version_text
from humanoid_sim.hardware.robstride.messages import DeviceId, GetDeviceId
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, fault_word
from humanoid_sim.robots.motors import motor_model

__all__ = ["ping"]

_SHOWN = ("run_mode", "mechPos", "mechVel", "VBUS", "limit_torque", "canTimeout")


def ping(config: Ping) -> int:
    """Ask, print, and return the exit status.

    Raises:
        InputError: an option is not accepted.
        SilentMotorError: the motor does not answer.
        RobotError: the channel cannot be used, or the motor cannot be enabled.
    """
    if not 1 <= config.count <= 10_000:
        raise InputError(f"--count: is {config.count}, expected 1 to 10000")
    if config.model is not None:
        motor_model(config.model)
    with open_client(config.channel, config.motor_id, config.host_id) as client:
        uid = read_device_id(client, config.motor_id).uid
        print(f"motor {config.motor_id} on {client.address}, unique id {uid.hex()}")
        _time_answers(client, config)
        for name in _SHOWN:
            print(f"  {name:<13} {shown(PARAMETERS[name], read_value(client, config.motor_id, PARAMETERS[name]))}")
        if config.read_status:
            _read_status(client, config)
    return 0


def _time_answers(client: MotorClient, config: Ping) -> None:
    question = GetDeviceId(config.motor_id, host_id=config.host_id)
    times = []
    for _ in range(config.count):
        begin = time.perf_counter()
        if client.ask(question, lambda reply: reply if isinstance(reply, DeviceId) else None, attempts=1):
            times.append(1e3 * (time.perf_counter() - begin))
    summary = f"median {statistics.median(times):.2f} ms, max {max(times):.2f} ms" if times else "none came back"
    print(f"  answered      {len(times)} of {config.count}, {summary}")


def _read_status(client: MotorClient, config: Ping) -> None:
    version = read_version(client, config.motor_id)
    name = config.model or (None if version is None else model_name(version))
    if name is None:
        raise InputError("--model: is needed, the motor does not tell its firmware; expected such as rs-02")
    model = motor_model(name)
    if version is not None:
        model = firmware_of(model, version).applied_to(model)
        print(f"  firmware      {version_text(version)}")
    client.set_model(config.motor_id, model)
    with EnabledMotor(client, config.motor_id) as motor:
        status = motor.command(0.0, 0.0, 0.0, 0.0)
    print(f"  model         {name}")
    print(f"  position      {status.position:.4f} rad")
    print(f"  velocity      {status.velocity:.4f} rad/s")
    print(f"  effort        {status.effort:.3f} N·m")
    print(f"  temperature   {status.temperature:.1f} °C")
    word = read_value(client, config.motor_id, fault_word(name))
    # The word shows overvoltage as well, which no status does.
    faults = flag_names(FaultBit(int(word))) if word is not None else flag_names(status.faults)
    print(f"  faults        {', '.join(faults) or 'none'}")
    print("  stopped again")
