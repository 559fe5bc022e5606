"""`hardware set-id`: another id for the only motor on a bus."""

from __future__ import annotations

from dataclasses import replace

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.messages import SetDeviceId
from humanoid_sim.hardware.tools.bench import some_motors
from humanoid_sim.hardware.tools.only_motor import OnlyMotor, only_motor, save, warn_of_saving
from humanoid_sim.hardware.tools.options import SetId
from humanoid_sim.hardware.tools.terminal import confirm

_ATTEMPTS = 3
"""Times that the new id is sent: a lost frame leaves the motor at its old one."""
_QUIET = 0.2
"""s without an answer after which nobody else is expected."""


def set_id(config: SetId) -> int:
    """Ask for confirmation, set the id, verify it, save it, and return the exit status."""
    if not 1 <= config.new_id <= LARGEST_MOTOR_ID:
        raise InputError(f"new id: is {config.new_id}, expected 1 to {LARGEST_MOTOR_ID}")
    with only_motor(config.channel, config.host_id) as motor:
        print(f"found {motor}, and nobody else")
        if motor.motor_id == config.new_id:
            print(f"it has the id {config.new_id} already: nothing was changed")
            return 0
        warn_of_saving(motor)
        confirm(f"Give it the id {config.new_id}, now and beyond power-off?", config.yes, "the id was not changed")
        renamed = _rename(motor, config.new_id)
        save(renamed)
        print(f"motor {motor.motor_id} is now {config.new_id}, read back and saved")
        print("Mark the motor. To see that it has kept its id, switch it off and on, then:")
        print(f"  python -m humanoid_sim.hardware ping {config.channel} {config.new_id}")
    return 0


def _rename(motor: OnlyMotor, new_id: int) -> OnlyMotor:
    """Return the motor under its new id, where it and nobody else answers."""
    channels = motor.channels
    answers: dict[int, set[bytes]] = {}
    for _ in range(_ATTEMPTS):
        channels.requests.send({0: [SetDeviceId(motor.motor_id, new_id, host_id=channels.host_id)]})
        answers = {}
        for _, reply in channels.requests.scan([motor.motor_id, new_id, motor.motor_id, new_id], _QUIET):
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
