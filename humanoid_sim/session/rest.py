"""End of a run: joints that have come to rest, and damping that needs nothing but the robot."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping

import numpy as np

from humanoid_sim.controllers.base import DAMPING, Controller, Fault
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.messages import TickInput
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.robots.robot import Robot

_REST_VELOCITY = 0.02  # rad/s below which a joint is slow
_REST_TIME = 0.5  # s for which every joint must be slow: a held arm is slow when it is let go, and falls after
_OLD = 0.2  # s since a joint answered, after which its last velocity says nothing


class RestDetector:
    """Tells when the joints have come to rest: all of them slow, for a while."""

    def __init__(self, period: float) -> None:
        self._needed = max(round(_REST_TIME / period), 1)
        self._slow = 0

    def update(self, state: MITState) -> bool:
        """Return True if the joints are at rest."""
        known = np.abs(state.joint_velocity[np.isfinite(state.joint_velocity)])
        answers = bool((state.joint_age <= _OLD).all())
        is_slow = answers and known.size > 0 and bool((known < _REST_VELOCITY).all())
        self._slow = self._slow + 1 if is_slow else 0
        return self._slow > self._needed


def damp_without_supervisor(
    robot: Robot,
    controllers: Mapping[str, Controller],
    state: MITState,
    *,
    period: float,
    longest: float,
    pause: Callable[[float], None] | None,
) -> MITState:
    """Send DAMPING's command until the joints rest, after something broke; return the last state.

    Whatever fails here, the next tick tries again: a bus that lost one frame may take the next, and the exception that
    brought the run here is the one that is reported.

    Args:
        controllers: by name; without a damping controller, or where it fails, the command is zero torque.
        state: the last one that was read; stands in for those that cannot be.
        period: s between two commands.
        longest: s at most; 0 for one command of zero torque, where the robot was without torque before.
        pause: waits between two commands; None not to wait.
    """
    rest, interrupted = RestDetector(period), None
    command = MITCommand.zeros(len(robot.joints))
    if longest > 0.0:
        with contextlib.suppress(Exception):
            command = _damped_command(robot.joints, controllers[DAMPING], state) or command
    for _ in range(round(longest / period) + 1):
        try:
            with contextlib.suppress(Exception):
                state, _ = robot.read()
            with contextlib.suppress(Exception):
                robot.write(command)
            if rest.update(state):
                break
            if pause is not None and longest > 0.0:
                pause(period)
        except BaseException as error:  # an impatient Ctrl-C: the robot is damped first
            interrupted = interrupted or error
    if interrupted is not None:
        raise interrupted
    return state


def _damped_command(joints: tuple[str, ...], controller: Controller, state: MITState) -> MITCommand | None:
    tick_input = TickInput(state)
    memory = controller.activate(tick_input)
    result = memory if isinstance(memory, Fault) else controller.update(memory, tick_input)
    return None if isinstance(result, Fault) or command_problem(result[1], joints) else result[1]
