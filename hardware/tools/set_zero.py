"""`hardware set-zero`: the present position of the only motor on a bus becomes its zero."""

from __future__ import annotations

import time

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.robstride.messages import SetZero as SetZeroCommand
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, RunMode
from humanoid_sim.hardware.tools.bench import command_motor, read_value
from humanoid_sim.hardware.tools.only_motor import OnlyMotor, only_motor, save, warn_of_saving
from humanoid_sim.hardware.tools.options import SetZero
from humanoid_sim.hardware.tools.terminal import confirm

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
        warn_of_saving(motor)
        print(f"its position is {before:.3f} rad; a calibration of its joint is void afterwards")
        confirm("Is the shaft where its zero shall be?", config.yes, "the zero was not changed")
        _require_still(motor)
        command_motor(motor.channels, SetZeroCommand(motor.motor_id, host_id=motor.channels.host_id))
        after = _position(motor)
        if not abs(after) <= _NEAR:
            raise RobotError(f"motor {motor.motor_id}: reads {after:.3f} rad after its zero was set, expected 0")
        save(motor)
        print(f"its position was {before:.3f} rad and is now {round(after, 3) + 0.0:.3f}, read back and saved")
        print("To see that it has kept its zero, switch it off and on without turning it, then:")
        print(f"  python -m humanoid_sim.hardware param get {config.channel} {motor.motor_id} mechPos   # 0 or 6.283")
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
