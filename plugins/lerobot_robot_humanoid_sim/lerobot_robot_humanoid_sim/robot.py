"""The robot: joints of a running session, as LeRobot observes and commands them."""

import time
from functools import cached_property
from typing import Any

import numpy as np
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from humanoid_sim.client import Feed, find_session
from humanoid_sim.messages import Mode
from humanoid_sim.robots.description import RobotDescription
from lerobot_robot_humanoid_sim.config import HumanoidSimCameraConfig, HumanoidSimConfig
from lerobot_robot_humanoid_sim.sender import Sender

_IMU = {
    "imu_quaternion": ("quaternion.w", "quaternion.x", "quaternion.y", "quaternion.z"),
    "imu_angular_velocity": ("gyro.x", "gyro.y", "gyro.z"),
    "imu_linear_acceleration": ("acceleration.x", "acceleration.y", "acceleration.z"),
}


class HumanoidSim(Robot):
    """A session of humanoid_sim in mode REMOTE, simulated or on motors.

    Modes are the operator's: `connect` names the one that is missing, and asks for none. Limits, guards and what
    happens when commands stop are the session's.
    """

    config_class = HumanoidSimConfig
    name = "humanoid_sim"

    def __init__(self, config: HumanoidSimConfig) -> None:
        """Attach to the session's feed, which knows the joints. Raises `SessionError` if there is no such session."""
        super().__init__(config)
        self.config = config
        self._session = find_session(config.session)
        self._feed = Feed(self._session)
        self._sender: Sender | None = None
        for camera in config.cameras.values():
            if isinstance(camera, HumanoidSimCameraConfig) and camera.session is None:
                camera.session = self._session.process
        self.cameras = make_cameras_from_configs(config.cameras)

    @cached_property
    def _values(self) -> dict[str, tuple[str, ...]]:
        """Fields of a tick that are observed, and the names of their values."""
        suffixes = {"joint_position": "pos"}
        suffixes |= {"joint_velocity": "vel"} if self.config.velocities else {}
        suffixes |= {"joint_effort": "effort"} if self.config.efforts else {}
        names = {field: tuple(f"{joint}.{end}" for joint in self._feed.joint_names) for field, end in suffixes.items()}
        return names | (_IMU if self.config.imu else {})

    @cached_property
    def observation_features(self) -> dict[str, type | tuple[int, ...]]:
        """Names and types of what is observed."""
        cameras = {name: (camera.height, camera.width, 3) for name, camera in self.config.cameras.items()}
        return {name: float for names in self._values.values() for name in names} | cameras

    @cached_property
    def action_features(self) -> dict[str, type]:
        """Names and types of an action: the joints' positions, rad."""
        return {f"{joint}.pos": float for joint in self._feed.joint_names}

    @property
    def is_connected(self) -> bool:
        """Return True while commands are sent."""
        return self._sender is not None

    @property
    def is_calibrated(self) -> bool:
        """Return True: calibration is the session's."""
        return True

    def calibrate(self) -> None:
        """Do nothing: calibration is the session's."""

    def configure(self) -> None:
        """Do nothing: gains and limits are the robot description's and the session's."""

    def connect(self, calibrate: bool = True) -> None:
        """Start the cameras, and send actions from now on. Raises `DeviceNotConnectedError` in any mode but REMOTE."""
        if self._sender is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        description = RobotDescription.from_json(self._feed.document("robot"))
        sender = Sender(self._session, description, self._feed.control_period, self.config.approach_speed)
        try:
            if self.config.wait_s > 0.0:
                sender.hold(_commanded(self._tick()))
            end = time.monotonic() + self.config.wait_s
            while self._tick()["mode"] != Mode.REMOTE and time.monotonic() < end:
                time.sleep(0.05)
            self._remote_tick()
            for camera in self.cameras.values():
                camera.connect()
        except BaseException:
            self._stop(sender)
            raise
        self._sender = sender

    def get_observation(self) -> dict[str, Any]:
        """Return the newest tick's values and the newest pictures."""
        if self._sender is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        tick, observation = self._tick(), {}
        for field, names in self._values.items():
            observation |= zip(names, map(float, tick[field]), strict=True)
        return observation | {name: camera.read_latest() for name, camera in self.cameras.items()}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Command joint positions, rad, and return them. Raises `DeviceNotConnectedError` if the mode is not REMOTE."""
        if self._sender is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        tick = self._remote_tick()
        goal = {name: float(action[name]) for name in self.action_features}
        for name, value in goal.items():
            if not np.isfinite(value):
                raise ValueError(f"{name}: is {value}, expected a finite number")
        self._sender.add(np.array(list(goal.values())), _commanded(tick))
        return goal

    def disconnect(self) -> None:
        """Send no more: the session's passive hold follows, in the mode that it is in."""
        if self._sender is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        self._stop(self._sender)
        self._sender = None

    def _stop(self, sender: Sender) -> None:
        sender.stop()
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()

    def _tick(self) -> dict[str, Any]:
        """Return the newest tick."""
        sample = self._feed.latest() or self._feed.wait(0, 5.0)
        if sample is None or not self._feed.is_running():
            raise DeviceNotConnectedError(f"{self._session}: has ended")
        return self._feed.decode(sample)

    def _remote_tick(self) -> dict[str, Any]:
        tick = self._tick()
        if tick["mode"] != Mode.REMOTE:
            raise DeviceNotConnectedError(
                f"{self._session}: is in {Mode(tick['mode']).name}, expected REMOTE; an operator enters it from "
                "STANDBY (python -m humanoid_sim.mode load_b, then start_remote)"
            )
        return tick


def _commanded(tick: dict[str, Any]) -> np.ndarray:
    """Return the joint positions that the session commands, rad; where it commands none, the measured ones."""
    return np.where(np.isfinite(tick["command_position"]), tick["command_position"], tick["joint_position"])
