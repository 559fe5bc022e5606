"""Where joints have been while somebody moved them: what `hardware calibrate` watches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from humanoid_sim.hardware.calibration import Sweep
from humanoid_sim.hardware.cli.client import MotorClient
from humanoid_sim.hardware.cli.exchange import poll_values
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.hardware.robstride.parameters import PARAMETERS

__all__ = ["JointTrack", "JointTracks"]

_ANSWER_TIME = 0.1
"""s that a poll waits for the slowest motor; as a rule all have answered within a few ms."""
_SILENT = 1.0
"""s without a position after which a motor counts as silent."""


@dataclass(slots=True)
class JointTrack:
    """What was seen of one joint."""

    angle: float = math.nan
    """rad, `direction · motor`, without an offset."""
    heard: float = -math.inf
    """s, when."""
    sweep: Sweep = field(default_factory=Sweep)
    restarts: int = 0
    """Times that the sweep began anew, because the motor was silent meanwhile."""

    def take(self, angle: float, time: float) -> None:
        """Take a position, rad, heard at `time`, s.

        A motor that was silent may have been without power, and then counts its turns anew: what was swept before says
        nothing any more.
        """
        if self.is_silent(time) and math.isfinite(self.heard):
            self.sweep = Sweep()
            self.restarts += 1
        self.angle, self.heard = angle, time
        self.sweep = self.sweep.with_angle(angle)

    def is_silent(self, time: float) -> bool:
        """Whether nothing was heard lately."""
        return time - self.heard > _SILENT


class JointTracks:
    """The tracks of some joints of a robot, by index, fed by `poll`."""

    def __init__(self, wiring: Wiring, clients: Sequence[MotorClient], joints: Sequence[int], begin: float) -> None:
        """Nothing is heard yet; `begin`, s, is now."""
        self._wiring = wiring
        self._clients = clients
        self._begin = begin
        self.by_joint = {i: JointTrack() for i in joints}

    def poll(self, time: float) -> None:
        """Read every motor's `mechPos`, which counts turns and does not wrap. Reading is all that they are asked for.

        Raises:
            SilentMotorError: a motor has never been heard.
            RobotError: a channel is down.
        """
        for channel, client in enumerate(self._clients):
            joints = {self._wiring.motor_id[i]: i for i in self.by_joint if self._wiring.channel[i] == channel}
            for motor_id, position in poll_values(client, list(joints), PARAMETERS["mechPos"], _ANSWER_TIME).items():
                i = joints[motor_id]
                self.by_joint[i].take(float(self._wiring.direction[i]) * position, time)
        if time - self._begin > _SILENT:
            for i, track in self.by_joint.items():
                if track.heard == -math.inf:
                    who = f"{self._wiring.names[i]} (motor {self._wiring.motor_id[i]})"
                    raise self._clients[self._wiring.channel[i]].silence(who)
