"""Everything before a robot is enabled: who is there, are they stopped and sound, where are they, what may they do.

Whatever is wrong ends it with one `RobotError` that holds all of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from humanoid_sim.hardware.adapter.joint_tracking import find_turns, turn_problems
from humanoid_sim.hardware.adapter.robot_motors import RobotMotors
from humanoid_sim.hardware.adapter.wiring import Wiring
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription


def prepare_motors(wiring: Wiring, motors: RobotMotors, checks: CheckList) -> FloatArray:
    """Identify, stop, configure and verify; leaves the motors stopped.

    Nothing is written to any motor before every expected one has been identified and nobody else drives them.

    Returns:
        The turns of `find_turns`, shape (n,); NaN for motors that tell nothing before they are enabled.
    """
    for link in motors.links:
        link.examine(checks)
    checks.refuse()
    for link in motors.links:
        link.make_ready(checks)
    unknown = motors.unknown_positions()
    turns = _find_positions(wiring, motors, [i for i in range(wiring.count) if i not in unknown], checks)
    for i in sorted(unknown):
        checks.passed(wiring.names[i], "tells its position once it is enabled, not before")
    checks.refuse()
    for link in motors.links:
        link.start(checks)
    motors.check(checks)
    checks.refuse()
    return turns


def enable_motors(wiring: Wiring, motors: RobotMotors, turns: FloatArray, checks: CheckList) -> FloatArray:
    """Enable every motor, without torque; those first that nothing stops by themselves, and that tell nothing before.

    Returns:
        The turns of all joints, shape (n,).
    """
    unknown = sorted(motors.unknown_positions())
    for link in sorted(motors.links, key=lambda link: link.knows_positions):
        link.enable(checks)
        checks.refuse()
        if not link.knows_positions:
            turns = np.where(np.isin(np.arange(wiring.count), unknown), np.nan, turns)
            found = _find_positions(wiring, motors, unknown, checks)
            turns = np.where(np.isnan(turns), found, turns)
            checks.refuse()
    return turns


def _find_positions(wiring: Wiring, motors: RobotMotors, joints: Sequence[int], checks: CheckList) -> FloatArray:
    """Return the turns of `find_turns` for these joints, NaN for the others."""
    position = motors.readings().position
    turns = find_turns(wiring, position)
    wrong = {
        joint: text for joint, text in turn_problems(wiring, position, turns) if wiring.names.index(joint) in joints
    }
    for joint, text in wrong.items():
        checks.problem(joint, text)
    counted = motors.counted()
    for i in joints:
        name, own = wiring.names[i], counted.get(i, position[i])
        if own is None:
            checks.warn(name, "mechPos cannot be read: whether it turned beyond ±4π since power-on is not known")
        elif not abs(own - position[i]) < wiring.position_range[i]:  # they differ by whole periods, and by the motion
            checks.problem(
                name,
                f"counts {own:.2f} rad by itself and reports {position[i]:.2f}: it turned beyond ±4π since power-on; "
                "switch it off and on",
            )
        elif name not in wrong:
            joint = wiring.direction[i] * (position[i] + 2.0 * np.pi * turns[i] - wiring.offset[i])
            counts = f" ({turns[i]:+.0f} turn)" if turns[i] else ""
            degrees = round(float(np.rad2deg(joint)), 1) + 0.0
            checks.passed(name, f"at {round(joint, 3) + 0.0:.3f} rad = {degrees:.1f}°{counts}")
    return np.where(np.isin(np.arange(wiring.count), list(joints)), turns, np.nan)


def gain_warnings(description: RobotDescription, wiring: Wiring) -> Iterator[tuple[str, str]]:
    """Joint and what is cut off there: a controller's gain beyond its motor's range. A policy's are checked with it."""
    standby = (
        ("standby_controller_a", description.standby_controller_a),
        ("standby_controller_b", description.standby_controller_b),
    )
    passive = (
        ("damping_controller", description.mode_damping),
        ("remote_policy_controller", description.passive_damping),
    )
    stiffness = [model.stiffness for model in wiring.model]
    damping = [model.damping for model in wiring.model]
    for name, settings in standby:
        yield from _beyond(wiring, f"{name}.target_stiffness", settings.target_stiffness, stiffness)
        yield from _beyond(wiring, f"{name}.target_damping", settings.target_damping, damping)
    for name, values in passive:
        yield from _beyond(wiring, f"{name}'s damping", values.tolist(), damping)


def _beyond(wiring: Wiring, what: str, gains: Sequence[float], limits: Sequence[float]) -> Iterator[tuple[str, str]]:
    for i, (gain, limit) in enumerate(zip(gains, limits, strict=True)):
        if gain > limit:
            yield wiring.names[i], f"{what} is {gain:g}, an {wiring.model[i].name} is told {limit:g} at most"
