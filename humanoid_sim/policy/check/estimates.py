"""Observation terms that a simulation knows and a robot may not."""

from __future__ import annotations

from collections.abc import Iterator

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.check.finding import Finding
from humanoid_sim.robots.description import RobotDescription

__all__ = ["estimate_findings", "rate_finding"]

_ESTIMATES = {
    "base_lin_vel": "the velocity of the base",
    "motion_anchor_pos": "the position of the anchor body",
    "motion_anchor_ori": "the pose of the anchor body",
}
_RATE_TOLERANCE = 1e-6


def estimate_findings(contract: PolicyContract, *, hardware: bool) -> Iterator[Finding]:
    """Terms that need an estimator on a robot: an error on hardware, which has none."""
    for term in contract.terms:
        what = _ESTIMATES.get(term.kind)
        if what is None:
            continue
        message = f"needs {what}, which a simulation knows and a robot has to estimate"
        if hardware:
            yield Finding("error", f"observation term {term.name}", f"{message}; there is no estimator")
        else:
            yield Finding("info", f"observation term {term.name}", message)


def rate_finding(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Whether the policy's period is a whole number of the real robot's control periods."""
    frequency = description.hardware.control_frequency
    ticks = contract.policy_dt * frequency
    if round(ticks) < 1 or abs(ticks - round(ticks)) > _RATE_TOLERANCE * ticks:
        message = f"is {contract.policy_dt:g} s, no multiple of the robot's control period, {1.0 / frequency:g} s"
        yield Finding("warning", "policy_dt", f"{message}: it has to run at another rate", value=contract.policy_dt)
