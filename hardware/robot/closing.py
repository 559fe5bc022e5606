"""How a robot is left: damped until its joints rest, every motor disabled, and that verified."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from humanoid_sim.hardware.robot.activation import set_reports
from humanoid_sim.hardware.robot.link import Link
from humanoid_sim.hardware.robot.settings import AdapterSettings
from humanoid_sim.hardware.robot.stopping import mode_text, stop_motors
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.session.rest import RestDetector

__all__ = ["damp_until_rest", "disable", "is_damped", "is_limp", "unconfirmed"]

_LONGEST = 3.0
"""s that damping may take, as at the end of a session."""
_PERIOD = 0.01
"""s between its commands."""
_LAST_ANSWERS = 0.1
"""s at most in which the last commands are answered."""
_SLOW = 0.05
"""rad/s below which a joint that is damped already needs no more of it."""


def is_limp(command: MITCommand) -> bool:
    """Whether a command exerts no torque, whatever the joints do."""
    return not (command.stiffness.any() or command.damping.any() or command.effort.any())


def is_damped(command: MITCommand, state: MITState, stale: float) -> bool:
    """Whether the joints are known to rest under a command that only damps them.

    A joint that has been silent for more than `stale` s may have been at rest then, and fall now.
    """
    passive = not (command.stiffness.any() or command.effort.any())
    slow = bool((np.abs(state.joint_velocity) < _SLOW).all())
    return passive and slow and bool((state.joint_age <= stale).all())


def damp_until_rest(read: Callable[[], MITState], damp: Callable[[], None], stale: float) -> None:
    """Damp until the joints are known to rest, for 3 s at most, and for all of that where one is silent."""
    rest = RestDetector(_PERIOD)
    deadline = time.monotonic() + _LONGEST
    while time.monotonic() < deadline:
        damp()
        state = read()
        if (state.joint_age > stale).any():
            rest = RestDetector(_PERIOD)
        elif rest.update(state):
            return
        time.sleep(_PERIOD)


def disable(settings: AdapterSettings, link: Link, reporting: Iterable[int]) -> tuple[int, ...]:
    """Stop all motors and their active reports; the joints whose motors did not confirm it, asked twice over."""
    link.wait(lambda: link.unanswered <= 0, _LAST_ANSWERS)
    link.table.counts_answers = False
    link.forget_queues()
    set_reports(link.requests, reporting, is_on=False)
    joints: Sequence[int] = range(settings.wiring.count)
    for _ in range(2):
        joints = stop_motors(link.requests, joints)
    return tuple(joints)


def unconfirmed(settings: AdapterSettings, link: Link | None, joints: Iterable[int]) -> str:
    """What to tell whoever stands next to motors that may still be enabled."""
    samples = {} if link is None else {i: link.table.slots[i].sample for i in joints}
    names = ", ".join(f"{settings.wiring.names[i]} ({mode_text(samples.get(i))})" for i in joints)
    return (
        f"not confirmed to be disabled: {names}. Without commands their CAN timeout stops them after "
        f"{1000.0 * settings.can_timeout:g} ms; switch the power off before touching the robot"
    )
