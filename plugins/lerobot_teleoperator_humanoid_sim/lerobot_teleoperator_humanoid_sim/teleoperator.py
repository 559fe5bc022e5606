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
_TURNS = {
    "i": (0.0, 1.0, 0.0), "k": (0.0, -1.0, 0.0), "j": (0.0, 0.0, 1.0),
    "l": (0.0, 0.0, -1.0), "u": (-1.0, 0.0, 0.0), "o": (1.0, 0.0, 0.0),
}  # fmt: skip
"""Down, up, left, right, and a roll to the left and to the right, about axes of the base frame."""
_ALL, _HOME = "0", "h"
HELP = """w s forward, back   a d left, right   r f up, down
i k turn down, up   j l turn left, right   u o roll left, right
1 2 … one hand alone   0 all   h back to the first pose"""
_DAMPING = 0.03
"""m/rad: the arms stay calm at the end of their reach."""
_ITERATIONS = 5
_LEASH, _SLACK = 0.03, 0.3
"""m and rad by which a goal may be ahead of where the hand can be."""


class HumanoidSimTeleoperator(Teleoperator):
    """Hands led by keys: positions and orientations relative to the robot's base, within its joints' limits."""

    config_class = HumanoidSimTeleoperatorConfig
    name = "humanoid_sim"

    def __init__(self, config: HumanoidSimTeleoperatorConfig) -> None:
        """Attach to the session's feed, and build the robot's kinematics. Raises `SessionError` if there is none."""
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
        """Return whether keys are read."""
        return self._keys is not None

    @property
    def is_calibrated(self) -> bool:
        """Return True: there is nothing to calibrate."""
        return True

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing."""

    def connect(self, calibrate: bool = True) -> None:
        """Begin where the robot's hands are commanded to be."""
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        sample = self._feed.latest() or self._feed.wait(0, 5.0)
        if sample is None:
            raise DeviceNotConnectedError(f"{self._session}: has ended")
        tick = self._feed.decode(sample)
        measured, commanded = tick["joint_position"], tick["command_position"]
        self._home = self._q = np.where(np.isfinite(commanded), commanded, measured)
        self._position, self._rotation = self._forward(self._q)
        self._led = range(len(self._position))
        self._time = time.monotonic()
        config = self.config
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
        goal = self._inverse.solve(self._position, self._rotation, self._q, posture=self._home, iterations=_ITERATIONS)
        self._q = self._q + np.clip(goal - self._q, -reach, reach)
        self._leash()
        return dict(zip(self.action_features, self._q.tolist(), strict=True))

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing: a keyboard feels nothing."""

    def disconnect(self) -> None:
        """Give the keyboard back."""
        if self._keys is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        self._keys.close()
        self._keys = None

    def _press(self, key: str) -> None:
        if key in _MOVES:
            self._position[self._led] += self.config.step * np.array(_MOVES[key])
        elif key in _TURNS:
            self._rotation[self._led] = _rotation(self.config.turn * np.array(_TURNS[key])) @ self._rotation[self._led]
        elif key == _ALL:
            self._led = range(len(self._position))
        elif key == _HOME:
            self._position, self._rotation = self._forward(self._home)
        elif key.isdecimal() and int(key) <= len(self._position):
            self._led = range(int(key) - 1, int(key))

    def _leash(self) -> None:
        """Keep the goals near the hands, so that a key that leads back acts at once."""
        position, rotation = self._forward(self._q)
        ahead = self._position - position
        distance = np.linalg.norm(ahead, axis=-1, keepdims=True)
        self._position = position + ahead * np.minimum(1.0, _LEASH / np.maximum(distance, 1e-9))
        for hand, turn in enumerate(self._rotation @ rotation.transpose(0, 2, 1)):
            vector, quaternion = np.empty(3), np.empty(4)
            mujoco.mju_mat2Quat(quaternion, turn.ravel())
            mujoco.mju_quat2Vel(vector, quaternion, 1.0)
            angle = np.linalg.norm(vector)
            if angle > _SLACK:
                self._rotation[hand] = _rotation(vector * _SLACK / angle) @ rotation[hand]


def _rotation(vector: np.ndarray) -> np.ndarray:
    """Return the matrix of a turn about a vector by its length, rad."""
    angle = float(np.linalg.norm(vector))
    quaternion, matrix = np.empty(4), np.empty(9)
    mujoco.mju_axisAngle2Quat(quaternion, vector / angle, angle)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
