"""Which motors of a robot need a guardian, what it is told, and what remains all the same."""

from __future__ import annotations

import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.adapter.wiring import AdapterSettings
from humanoid_sim.hardware.bus.open_channels import Locks
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.hardware.guardian.guardian import SOURCE, Guardian, can_share
from humanoid_sim.hardware.guardian.plan import GuardedMotor, GuardianPlan

__all__ = ["guarded_joints", "start_guardian"]


def guarded_joints(settings: AdapterSettings) -> tuple[int, ...]:
    """Joints whose motors execute their last command for ever when their host falls silent."""
    return settings.wiring.endless


def _plan(settings: AdapterSettings) -> GuardianPlan:
    """Each family's own frames, with the damping of a session's end."""
    wiring, motors = settings.wiring, {}
    for family, driver in DRIVERS.items():
        joints = [i for i in guarded_joints(settings) if wiring.model[i].family == family]
        if not joints:
            continue
        assert driver.rescue is not None, f"{family} has no timeout and nothing for a guardian to send"
        frames = driver.rescue(wiring.select(joints), settings.damping[np.array(joints)])
        for i, (damping, reset) in zip(joints, frames, strict=True):
            motors[i] = GuardedMotor(wiring.names[i], settings.addresses[wiring.channel[i]], damping, reset)
    return GuardianPlan(tuple(motors[i] for i in sorted(motors)))


def start_guardian(settings: AdapterSettings, locks: Locks, checks: CheckList) -> Guardian | None:
    """A guardian that watches this process, where the robot needs one and its channels can be shared.

    Args:
        settings: the robot's.
        locks: of its channels, held.
        checks: takes what an operator should know.

    Raises:
        RobotError: it cannot be started; with everything else that is wrong.
    """
    joints = guarded_joints(settings)
    if not joints:
        return None
    names = ", ".join(settings.wiring.names[i] for i in joints)
    if not all(can_share(address) for address in settings.addresses):
        checks.warn(SOURCE, f"{names}: emulated in this process, with which they end; no guardian watches them")
        return None
    plan = _plan(settings)
    try:
        guardian = Guardian(plan, locks.descriptors)
    except RobotError as error:
        checks.problem(SOURCE, str(error))
        checks.refuse()
        raise
    checks.passed(
        SOURCE,
        f"process {guardian.pid} damps {names} for {plan.damping_time:g} s, then resets them, when this program is "
        f"silent for {1000.0 * plan.timeout:g} ms; {guardian.measures}",
    )
    checks.warn(
        SOURCE,
        f"{names} execute their last command for ever where nobody tells them otherwise: if the guardian is killed as "
        "well, the bus fails, or this computer loses its power, only the switch of their supply stops them",
    )
    return guardian
