"""`hardware set-id` and `set-zero`: lasting changes of one motor alone on a bus, as it is delivered.

On a robot with all its motors a wrong id would change the wrong one, and two with the factory's id would both obey. So
the motor is found, alone, and stopped before anything is changed.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.can_bus import parse_address
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.robstride.protocol import HERE, LARGEST_MOTOR_ID, SAVE, FrameType, encode_command
from humanoid_sim.hardware.tools import bench
from humanoid_sim.hardware.tools.options import SetId, SetZero

_QUIET = 0.2  # s without an answer after which no other is expected
_PACE = 0.002  # s between two ids: answers of motors that share an id come apart
_LISTENING = 0.1  # s of silence in which another host would be received
_SCANS = 2  # times that every id is asked: an answer may be lost, and two that collide may both be
_ATTEMPTS = 3  # times that a new id is sent: a lost frame leaves the motor at its old one
_NEAR = 0.01  # rad from zero at which it counts as set


def _scan(link: RobstrideLink, ids: Sequence[int]) -> set[tuple[int, bytes]]:
    """Return motor ids that answer, and their unique ids."""
    return {(reply.motor_id, reply.uid) for _, reply in link.scan(ids, _QUIET, _PACE)}


@contextlib.contextmanager
def _only_motor(channel: str) -> Iterator[tuple[RobstrideLink, bytes]]:
    """Find the one motor on a channel, and stop it; gives its unique id. Raises `RobotError` if it is not alone."""
    with bench.open_bench([parse_address(channel)]) as link:
        source, found = link.sources[0], set[tuple[int, bytes]]()
        for _ in range(_SCANS):
            found |= _scan(link, range(1, LARGEST_MOTOR_ID + 1))
        if not found:
            raise bench.silence(link, 0, "no motor answers")
        if len(found) > 1:
            names = ", ".join(f"{motor_id} (unique id {uid.hex()})" for motor_id, uid in sorted(found))
            raise RobotError(f"{source}: {len(found)} motors answer, expected one alone on the bus: {names}")
        ((motor_id, uid),) = found
        link.expect(bench.some_motors([(0, motor_id)], link.sources))
        time.sleep(_LISTENING)
        bench.check_channels(link)
        if troubles := link.line.channels[0].troubles():
            raise RobotError(f"{source}: {'; '.join(troubles)}: expected one motor alone, and no other host")
        if link.stop_motors([0]):
            raise bench.SilentMotorError(f"{link.motors.names[0]}: does not confirm that it is stopped")
        print(f"found motor {motor_id} on {source}, unique id {uid.hex()}, and no other")
        yield link, uid


def _save(link: RobstrideLink, uid: bytes) -> None:
    """Let the motor keep its values beyond power-off, and check that it is still the one that answers."""
    bench.command_motor(link, FrameType.SAVE_PARAMETERS, SAVE)
    if (found := bench.ask_uid(link)) != uid:
        raise RobotError(f"{link.motors.names[0]}: unique id {found.hex()} answers, expected {uid.hex()}")


def set_id(config: SetId) -> int:
    """Ask for confirmation, set the id, verify it, save it, and return the exit status."""
    new_id = config.new_id
    if not 1 <= new_id <= LARGEST_MOTOR_ID:
        raise InputError(f"new id: is {new_id}, expected 1 to {LARGEST_MOTOR_ID}")
    with _only_motor(config.channel) as (link, uid):
        old_id = link.motors.motor_id[0]
        if old_id == new_id:
            print(f"it has the id {new_id} already: nothing was changed")
            return 0
        bench.confirm(f"Give it the id {new_id}, now and beyond power-off?", config.yes, "the id was not changed")
        found: set[tuple[int, bytes]] = set()
        for _ in range(_ATTEMPTS):
            if found != {(new_id, uid)}:
                link.send({0: [encode_command(FrameType.SET_DEVICE_ID, old_id, high=new_id)]})
                found = _scan(link, [old_id, new_id] * 2)
        if found != {(new_id, uid)}:
            ids = ", ".join(str(motor_id) for motor_id, _ in sorted(found)) or "none"
            raise RobotError(f"motor {old_id} did not become {new_id}: ids that answer now: {ids}")
        link.expect(bench.some_motors([(0, new_id)], link.sources))
        _save(link, uid)
        print(f"motor {old_id} is now {new_id}, read back and saved")
        print("Mark the motor. To see that it has kept its id, switch it off and on, then:")
        print(f"  python -m humanoid_sim.hardware ping {config.channel} {new_id}")
    return 0


def set_zero(config: SetZero) -> int:
    """Ask for confirmation, set the zero, verify it, save it, and return the exit status."""
    with _only_motor(config.channel) as (link, uid):
        motor_id = link.motors.motor_id[0]
        before = bench.read_value(link, PARAMETERS["mechPos"])
        print(f"its position is {before:.3f} rad; a calibration of its joint is void afterwards")
        bench.confirm("Is the shaft where its zero shall be?", config.yes, "the zero was not changed")
        bench.command_motor(link, FrameType.SET_ZERO, HERE)
        after = bench.read_value(link, PARAMETERS["mechPos"])
        if after is None or not abs(after) <= _NEAR:
            raise RobotError(f"motor {motor_id}: reads {after} rad after its zero was set, expected 0: hold it still")
        _save(link, uid)
        print(f"its position is now {after:.3f} rad, read back and saved")
        print("To see that it has kept its zero, switch it off and on without turning it; then near 0 or 6.28:")
        print(f"  python -m humanoid_sim.hardware param get {config.channel} {motor_id} mechPos")
    return 0
