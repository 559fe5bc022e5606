"""Motors on a bench that cannot be asked: listened to, or enabled limp for as long as a tool needs them."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.adapter.guarding import MotorGuard
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.hardware.motors import MotorLink, SessionTerms
from humanoid_sim.hardware.robstride.requests import RobstrideLink
from humanoid_sim.hardware.tools.bench import silence, some_motors
from humanoid_sim.robots.motors import FAMILIES, MOTORS

LISTENING = 0.3
"""s in which a motor that sends feedback is heard: a Sito's comes every 255 ms at the latest."""
_PERIOD = 0.02
"""s between two frames of feedback."""
_COMMAND_PERIOD = 0.01
"""s between commands to a motor that is moved, at most."""
_ANSWER_TIME = 0.3
"""s without feedback after which a motor counts as silent."""
_POLL = 0.001
"""s"""


def title(family: str) -> str:
    """Return a family's name as it begins a sentence."""
    return family.capitalize()


def no_question(family: str) -> str:
    """Return why a motor of this family is not found."""
    return (
        f"the {title(family)} protocol has no question, so a motor that is not enabled stays silent and cannot be found"
    )


class Heard(NamedTuple):
    """Data received from one motor."""

    frames: int
    position: float
    """rad, motor frame."""
    velocity: float
    """rad/s"""


class Ear:
    """Listens on all channels for the motors of a family, whatever their ids, and sends nothing."""

    def __init__(self, family: str, channels: RobstrideLink) -> None:
        traits = FAMILIES[family]
        self._places = [(channel, number) for channel in range(len(channels.sources)) for number in traits.ids]
        motors = some_motors(self._places, channels.sources, MOTORS[traits.models[0].name])
        self._link = DRIVERS[family].link(channels.line, motors, SessionTerms(channels.host_id, 0.0, _PERIOD))
        channels.line.listeners.insert(0, self._link.receive)

    def heard(self) -> dict[tuple[int, int], Heard]:
        """Return what was heard of the motors that sent something, by channel and id."""
        readings = self._link.readings()
        frames = [self._link.figures(i).reports for i in range(len(self._places))]
        return {
            place: Heard(frames[i], float(readings.position[i]), float(readings.velocity[i]))
            for i, place in enumerate(self._places)
            if frames[i]
        }


@contextlib.contextmanager
def limp_motors(channels: RobstrideLink, joints: Sequence[int], guard: MotorGuard | None = None) -> Iterator[MotorLink]:
    """Enable these motors with zero gains and zero current, after all that a session checks; disabled at the end.

    Args:
        joints: whose motors, of one family.
        guard: of these motors, started; None where they stay limp.

    Raises:
        RobotError: another host drives them, one sends no feedback or reports torque, or does not confirm that it is
            disabled.
    """
    motors = channels.motors.select(joints)
    session = DRIVERS[motors.model[0].family].link(channels.line, motors, SessionTerms(channels.host_id, 0.0, _PERIOD))
    channels.line.listeners.insert(0, session.receive)
    checks = CheckList()
    try:
        session.examine(checks)
        session.make_ready(checks)
        if guard is not None:
            guard.standby()
        session.enable(checks)
        channels.line.check(checks)
        checks.refuse()
        yield session
    finally:
        if guard is not None:
            guard.take_back(channels.line.forget_queues)
        left = session.stop(range(motors.count))
        if guard is not None:
            guard.release([joints[i] for i in left])
        channels.line.listeners.remove(session.receive)
        if left:
            names = ", ".join(motors.names[i] for i in left)
            raise RobotError(
                f"{names}: not confirmed to be disabled, and nothing stops such a motor by itself; switch its power off"
            )


class Place(NamedTuple):
    """Feedback of a motor that is moved."""

    position: float
    """rad, motor frame."""


class MovedMotor:
    """Commands for one motor that is enabled."""

    def __init__(self, channels: RobstrideLink, session: MotorLink, torque: float, guard: MotorGuard | None) -> None:
        """Send nothing yet; `torque`, N·m, is what the commanded position may ask for. A guard is started already."""
        self._guard = guard
        self._channels = channels
        self._session = session
        self._torque = torque
        self._doubt = FAMILIES[session.motors.model[0].family].stiffness_doubt
        self._encoder = DRIVERS[session.motors.model[0].family].encoder(session.motors)

    @property
    def position(self) -> float:
        """rad, motor frame, as last heard."""
        return float(self._session.readings().position[0])

    def command(self, position: float, velocity: float, stiffness: float, damping: float) -> Place:
        """Send a command in the motor frame: rad, rad/s, N·m/rad, N·m·s/rad; where the motor is in its next feedback.

        It is sent in every period until then: the guardian must not take a silent motor for a tool that died.

        No torque limit is known: the commanded position, which stays within `torque / K_p` of the motor, is all that
        bounds it, with the largest K_p that the frame may mean.

        Raises:
            RobotError: another host commands it too, or its channel is down.
        """
        reach = self._torque / (stiffness * self._doubt) if stiffness > 0.0 else math.inf
        here = self.position
        bounded = min(max(position, here - reach), here + reach)
        values = np.array([[bounded], [velocity], [0.0], [stiffness], [damping]])
        motors = self._session.motors
        channel = self._channels.channels[motors.channel[0]]
        before = np.nan_to_num(self._session.readings().time[0], nan=-math.inf)
        begin, sent = time.monotonic(), -math.inf
        while True:
            now = time.monotonic()
            if now - sent >= _COMMAND_PERIOD:
                frames = self._encoder.encode(values).frames
                channel.send([((motors.names[0], kind), frame) for _, kind, frame in frames])
                if self._guard is not None:
                    self._guard.beat()
                sent = now
            if self._session.readings().time[0] > before:  # NaN: nothing was heard yet
                break
            if now - begin > _ANSWER_TIME:
                raise silence(self._channels, self._channels.motors.names.index(motors.names[0]), motors.names[0])
            time.sleep(_POLL)
        checks = CheckList()
        self._channels.line.check(checks)
        checks.refuse()
        return Place(self.position)
