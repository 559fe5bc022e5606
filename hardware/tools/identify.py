"""`hardware identify`: move one joint a little."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Collection, Iterator, Mapping

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError, RobotError, require_known
from humanoid_sim.hardware.bus.address import parse_addresses
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.robstride.firmware import parse_version
from humanoid_sim.hardware.robstride.link import RobstrideLink, Unreadable
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import open_bench, read_device_id
from humanoid_sim.hardware.tools.enabled_motor import EnabledMotor, MovedMotor, limp_motors
from humanoid_sim.hardware.tools.options import Identify
from humanoid_sim.hardware.tools.terminal import confirm
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import real_time

_PERIOD = 0.01
"""s between commands."""
_RAMP = 1.0
"""s to get there, and as long to get back."""
_HOLD = 0.5
"""s to stay there, so that it is seen."""
_DAMPING_TIME = 0.05
"""s, damping over stiffness: about critical for a forearm, and within every model's range."""
_MOVED = 0.3
"""Share of the angle from which on a joint counts as moved."""
_FARTHEST = 3.0
"""Share of the angle beyond which something else moves the joint, and it is let go."""
_ANSWER_TIME = 0.3
"""s that motors have to tell their positions, which takes them some milliseconds."""


def identify(config: Identify) -> int:
    """Ask for confirmation, move, print, and return the exit status."""
    description = load_robot(config.robot)
    require_known("joint", (config.joint,), description.joint_names)
    if not 0.02 <= config.angle <= 0.5:
        raise InputError(f"--angle: is {config.angle}, expected 0.02 to 0.5 rad")
    for version in config.accept_firmware:
        parse_version(version)
    addresses = parse_addresses(config.channels)
    wiring = make_wiring(description, len(addresses))
    joint = description.joint_names.index(config.joint)
    if not 0.0 < config.torque <= wiring.effort_limit[joint]:
        raise InputError(
            f"--torque: is {config.torque}, expected more than 0 and at most {wiring.effort_limit[joint]:g} N·m"
        )
    if joint in wiring.endless and not config.allow_no_timeout:
        raise InputError(
            f"{config.joint}: its motor executes its last command for ever when this program dies, for no timeout of "
            "its own is known; --allow-no-timeout accepts that"
        )
    with real_time(), open_bench(addresses, config.host_id, wiring) as channels:
        if joint not in wiring.unasked:
            read_device_id(channels, joint)
        source = channels.sources[wiring.channel[joint]]
        print(
            f"{config.joint}: motor {wiring.motor_id[joint]} on {source} will move the joint by "
            f"{config.angle:+g} rad and back within {2 * _RAMP + _HOLD:g} s, with at most {config.torque:g} N·m"
        )
        confirm("Is the arm supported and clear?", config.yes, "not moved")
        before = _positions(channels)
        with _enabled(config, wiring, joint, channels) as motor:
            start, after = _move(config, wiring, joint, channels, motor, before)
        before.setdefault(joint, start)
    return _report(config, wiring, joint, before, after)


def _positions(channels: RobstrideLink) -> dict[int, float]:
    """`mechPos` of every motor that tells it, rad, motor frame, by joint."""
    motors = range(channels.motors.count)
    found = channels.read(dict.fromkeys(motors, PARAMETERS["mechPos"]), (_ANSWER_TIME,))
    return {i: position for i, position in found.items() if not isinstance(position, Unreadable)}


@contextlib.contextmanager
def _enabled(
    config: Identify, wiring: Wiring, joint: int, channels: RobstrideLink
) -> Iterator[EnabledMotor | MovedMotor]:
    """Provide the joint's motor, enabled for a moment, and held to the torque."""
    if joint in wiring.unasked:
        with limp_motors(channels, [joint]) as session:
            yield MovedMotor(channels, session, config.torque)
        return
    with EnabledMotor(channels, joint, torque=config.torque, accepted_firmware=config.accept_firmware) as motor:
        yield motor


def _move(
    config: Identify,
    wiring: Wiring,
    joint: int,
    channels: RobstrideLink,
    motor: EnabledMotor | MovedMotor,
    asked: Collection[int],
) -> tuple[float, dict[int, float]]:
    """Move there and back; where the motor began, and what the asked motors' positions were when it was there."""
    step = float(wiring.direction[joint]) * config.angle
    stiffness = min(config.torque / config.angle, wiring.model[joint].stiffness)
    damping = min(_DAMPING_TIME * stiffness, wiring.model[joint].damping)
    start = motor.command(0.0, 0.0, 0.0, 0.0).position
    largest = wiring.position_range[joint]
    if abs(start + step) > largest:
        raise RobotError(
            f"{config.joint}: is at {start:.2f} rad, too near the end of what commands can say, ±{largest:.2f}"
        )

    there: dict[int, float] = {}

    def follow(begin_share: float, end_share: float, duration: float, asked: Collection[int] = ()) -> None:
        """Command; meanwhile ask for these motors' positions, until each has told it."""
        begin = time.monotonic()
        while (elapsed := time.monotonic() - begin) < duration:
            share = begin_share + (end_share - begin_share) * 0.5 * (1.0 - math.cos(math.pi * elapsed / duration))
            status = motor.command(start + share * step, 0.0, stiffness, damping)
            if abs(status.position - start) > _FARTHEST * config.angle:
                raise RobotError(f"{config.joint}: has moved by {status.position - start:+.2f} rad: let go")
            if missing := [i for i in asked if i not in there]:
                there.update(channels.poll_values(PARAMETERS["mechPos"], missing, 0.0))
            elif asked:
                break
            time.sleep(max(begin + elapsed + _PERIOD - time.monotonic(), 0.0))

    follow(0.0, 1.0, _RAMP)
    follow(1.0, 1.0, _HOLD)
    channels.take_answers()  # late answers to earlier questions
    follow(1.0, 1.0, _ANSWER_TIME, asked)
    if isinstance(motor, MovedMotor):
        there[joint] = motor.position
    follow(1.0, 0.0, _RAMP)
    motor.command(start, 0.0, stiffness, damping)  # where the program was slow, the ramp's last command is short of it
    return start, there


def _report(
    config: Identify, wiring: Wiring, joint: int, before: Mapping[int, float], after: Mapping[int, float]
) -> int:
    moved = {i: after[i] - before[i] for i in after if i in before}
    own = moved.pop(joint, math.nan)
    others = {i: angle for i, angle in moved.items() if abs(angle) >= _MOVED * config.angle}
    direction = float(wiring.direction[joint])
    print(
        f"motor {wiring.motor_id[joint]} moved by {own:+.3f} rad; with direction {direction:+g} "
        f"that is {direction * own:+.3f} rad of {config.joint}"
    )
    for i, angle in others.items():
        complain(f"warning: {wiring.names[i]} (motor {wiring.motor_id[i]}) moved as well, by {angle:+.3f} rad")
    has_moved = direction * own >= _MOVED * config.angle
    if has_moved:
        print(f"If {config.joint} did not go the way of a rising angle in the robot's model, its direction is wrong.")
    else:
        complain(f"warning: {config.joint} did not follow: raise --torque, or hold the arm's weight")
    return 0 if has_moved and not others else ExitStatus.FAILED
