"""The teleoperator: keys move the hands' goals, inverse kinematics makes joint positions of them."""

import os
import select
import sys
import termios
import time
import tty
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from humanoid_sim.client import Feed, SessionError, find_session
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.session.feed import MODEL_BLOB
from humanoid_sim.simulation.kinematics import ForwardKinematics, InverseKinematics

_MOVES = {
    "w": (1.0, 0.0, 0.0), "s": (-1.0, 0.0, 0.0), "a": (0.0, 1.0, 0.0),
    "d": (0.0, -1.0, 0.0), "r": (0.0, 0.0, 1.0), "f": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Forward, back, left, right, up and down in the base frame."""
HELP = "w s forward, back   a d left, right   r f up, down\n1 2 … one hand alone   0 all"
_DAMPING = 0.03  # m/rad: the arms stay calm at the end of their reach
_ITERATIONS = 5


@TeleoperatorConfig.register_subclass("humanoid_sim")
@dataclass(kw_only=True)
class HumanoidSimTeleoperatorConfig(TeleoperatorConfig):
    """Hands led from the terminal's keyboard."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    hands: list[str] = field(default_factory=list)
    """The bodies that are led. Default: the hands in the robot's file."""
    step: float = 0.005
    """m for each press."""
    max_joint_speed: float = 2.0
    """rad/s at which the joints follow, at most."""


class HumanoidSimTeleoperator(Teleoperator):
    """Hands led by keys: positions relative to the robot's base, within its joints' limits; orientations are kept."""

    config_class = HumanoidSimTeleoperatorConfig
    name = "humanoid_sim"
    feedback_features: dict[str, type] = {}  # noqa: RUF012 - as LeRobot has it
    is_calibrated = True
    is_connected = False

    def __init__(self, config: HumanoidSimTeleoperatorConfig) -> None:
        """Attach to a session. Raises `SessionError` if there is none, or its robot has no hands."""
        super().__init__(config)
        self.config = config
        self._session = find_session(config.session)
        self._feed = Feed(self._session)
        description = RobotDescription.from_json(self._feed.document("robot"))
        bodies = tuple(config.hands) or tuple(description.hands)
        if not bodies:
            raise SessionError(f"{self._session}: the robot's file names no hands; name bodies with --teleop.hands")
        data = self._feed.blob(MODEL_BLOB)
        models = [mujoco.MjModel.from_binary_path(MODEL_BLOB, {MODEL_BLOB: data}) for _ in range(2)]
        self._forward = ForwardKinematics(description, bodies, model=models[0])
        self._inverse = InverseKinematics(description, bodies, damping=_DAMPING, model=models[1])
        self._terminal: list[Any] | None = None  # its settings before
        self._joints = description.joint_names

    @property
    def action_features(self) -> dict[str, type]:
        return {f"{joint}.pos": float for joint in self._joints}

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...

    def send_feedback(self, feedback: dict[str, Any]) -> None: ...

    def connect(self, calibrate: bool = True) -> None:
        """Begin where the robot's hands are commanded to be, and let single keys of standard input through."""
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        sample = self._feed.latest() or self._feed.wait(0, 5.0)
        if sample is None:
            raise DeviceNotConnectedError(f"{self._session}: has ended")
        tick = self._feed.decode(sample)
        commanded = tick["command_position"]
        self._home = self._q = np.where(np.isfinite(commanded), commanded, tick["joint_position"])
        self._goal, self._rotation = self._forward(self._q)
        self._led = slice(None)
        self._time = time.monotonic()
        if sys.stdin.isatty():
            self._terminal = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
            print(HELP, flush=True)
        self.is_connected = True

    def get_action(self) -> dict[str, Any]:
        """Return joint positions, rad, that bring the hands towards where the keys have moved their goals."""
        if not self.is_connected:
            raise DeviceNotConnectedError(f"{self} is not connected")
        moved = np.zeros_like(self._goal)
        for key in _pressed():
            if key in _MOVES:
                moved[self._led] += self.config.step * np.array(_MOVES[key])
            elif key == "0":
                self._led = slice(None)
            elif key.isdecimal() and int(key) <= len(self._goal):
                self._led = slice(int(key) - 1, int(key))
        if moved.any():  # from where the hands are: a goal out of reach is forgotten, so that the way back acts at once
            self._goal = np.where(moved.any(axis=-1, keepdims=True), self._forward(self._q)[0] + moved, self._goal)
        now = time.monotonic()
        reach = self.config.max_joint_speed * min(now - self._time, 0.1)
        self._time = now
        wanted = self._inverse.solve(self._goal, self._rotation, self._q, posture=self._home, iterations=_ITERATIONS)
        self._q = self._q + np.clip(wanted - self._q, -reach, reach)
        return dict(zip(self.action_features, self._q.tolist(), strict=True))

    def disconnect(self) -> None:
        if not self.is_connected:
            raise DeviceNotConnectedError(f"{self} is not connected")
        if self._terminal is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._terminal)
        self.is_connected = False


def _pressed() -> str:
    """Return the keys that have come on standard input, a terminal or not."""
    if not select.select([sys.stdin], [], [], 0.0)[0]:
        return ""
    return os.read(sys.stdin.fileno(), 1024).decode(errors="ignore")  # nothing where it has ended
