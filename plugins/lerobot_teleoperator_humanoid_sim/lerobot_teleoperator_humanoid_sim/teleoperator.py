"""The teleoperator: keys move the hands' goals, inverse kinematics makes joint positions of them."""

import time
from typing import Any

import mujoco
import numpy as np
from lerobot.teleoperators import Teleoperator
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from humanoid_sim.client import Feed, SessionError, find_session
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.session.feed import MODEL_BLOB
from humanoid_sim.simulation.kinematics import ForwardKinematics, InverseKinematics
from lerobot_teleoperator_humanoid_sim.config import HumanoidSimTeleoperatorConfig
from lerobot_teleoperator_humanoid_sim.keyboard import Terminal, Typed

_MOVES = {
    "w": (1.0, 0.0, 0.0), "s": (-1.0, 0.0, 0.0), "a": (0.0, 1.0, 0.0),
    "d": (0.0, -1.0, 0.0), "r": (0.0, 0.0, 1.0), "f": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Forward, back, left, right, up and down in the base frame."""
HELP = """w s forward, back   a d left, right   r f up, down
1 2 … one hand alone   0 all   h back to the first pose"""
_DAMPING = 0.03  # m/rad: the arms stay calm at the end of their reach
_ITERATIONS = 5
_LEASH = 0.03  # m by which a goal may be ahead of where the hand can be, so that a key that leads back acts at once


class HumanoidSimTeleoperator(Teleoperator):
    """Hands led by keys: positions relative to the robot's base, within its joints' limits; orientations are kept."""

    config_class = HumanoidSimTeleoperatorConfig
    name = "humanoid_sim"

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
        self._joints = description.joint_names
        self._keys: Terminal | Typed | None = None

    @property
    def action_features(self) -> dict[str, type]:
        """Names and types of an action: the joints' positions, rad."""
        return {f"{joint}.pos": float for joint in self._joints}

    @property
    def feedback_features(self) -> dict[str, type]:
        """Return none: a keyboard feels nothing."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Return True while keys are read."""
        return self._keys is not None

    @property
    def is_calibrated(self) -> bool:
        """Return True: there is nothing to calibrate."""
        return True

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing."""

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing."""

    def connect(self, calibrate: bool = True) -> None:
        """Begin where the robot's hands are commanded to be."""
        if self._keys is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        sample = self._feed.latest() or self._feed.wait(0, 5.0)
        if sample is None:
            raise DeviceNotConnectedError(f"{self._session}: has ended")
        tick, config = self._feed.decode(sample), self.config
        commanded = tick["command_position"]
        self._home = self._q = np.where(np.isfinite(commanded), commanded, tick["joint_position"])
        self._goal, self._rotation = self._forward(self._q)
        self._led = slice(None)
        self._time = time.monotonic()
        self._keys = Typed(config.keys, config.key_period_s) if config.keys else Terminal()
        if not config.keys:
            print(HELP, flush=True)

    def get_action(self) -> dict[str, Any]:
        """Return joint positions, rad, that bring the hands towards where the keys have moved their goals."""
        if self._keys is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        for key in self._keys.pressed():
            self._press(key)
        now = time.monotonic()
        reach = self.config.max_joint_speed * min(now - self._time, 0.1)
        self._time = now
        wanted = self._inverse.solve(self._goal, self._rotation, self._q, posture=self._home, iterations=_ITERATIONS)
        self._q = self._q + np.clip(wanted - self._q, -reach, reach)
        hands = self._forward(self._q)[0]
        ahead = self._goal - hands
        distance = np.linalg.norm(ahead, axis=-1, keepdims=True)
        self._goal = hands + ahead * np.minimum(1.0, _LEASH / np.maximum(distance, 1e-9))
        return dict(zip(self.action_features, self._q.tolist(), strict=True))

    def disconnect(self) -> None:
        """Give the keyboard back."""
        if self._keys is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        self._keys.close()
        self._keys = None

    def _press(self, key: str) -> None:
        if key in _MOVES:
            self._goal[self._led] += self.config.step * np.array(_MOVES[key])
        elif key == "0":
            self._led = slice(None)
        elif key == "h":
            self._goal = self._forward(self._home)[0]
        elif key.isdecimal() and int(key) <= len(self._goal):
            self._led = slice(int(key) - 1, int(key))
