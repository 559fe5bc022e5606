"""Gains of the robot description that its motors' frames cannot carry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["gain_warnings"]


def gain_warnings(description: RobotDescription, wiring: Wiring) -> Iterator[tuple[str, str]]:
    """Joint and what is cut off there: a controller's gain beyond its motor's range. A policy's are checked with it."""
    n = wiring.count
    standby = (
        ("standby_controller_a", description.standby_controller_a),
        ("standby_controller_b", description.standby_controller_b),
    )
    passive = (
        ("damping_controller", description.damping_controller),
        ("remote_policy_controller", description.remote_policy_controller),
    )
    stiffness = [model.stiffness for model in wiring.model]
    damping = [model.damping for model in wiring.model]
    for name, settings in standby:
        yield from _beyond(wiring, f"{name}.target_stiffness", settings.target_stiffness, stiffness)
        yield from _beyond(wiring, f"{name}.target_damping", settings.target_damping, damping)
    for name, values in passive:
        yield from _beyond(wiring, f"{name}'s damping", values.damping or (values.damping_scalar,) * n, damping)


def _beyond(wiring: Wiring, what: str, gains: Sequence[float], limits: Sequence[float]) -> Iterator[tuple[str, str]]:
    for i, (gain, limit) in enumerate(zip(gains, limits, strict=True)):
        if gain > limit:
            yield wiring.names[i], f"{what} is {gain:g}, an {wiring.model[i].name} is told {limit:g} at most"
