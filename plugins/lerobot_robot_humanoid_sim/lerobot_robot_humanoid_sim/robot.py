"""The robot: joints of a running session, as LeRobot observes and commands them."""

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from lerobot.cameras import CameraConfig
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.robots import Robot, RobotConfig
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from humanoid_sim.client import Feed, Intake, find_session
from humanoid_sim.messages import Mode
from humanoid_sim.robots.description import RobotDescription

_LONGEST = 0.1  # s between two actions, after which the second counts as the first after a pause
_IMU = {
    "imu_quaternion": ("quaternion.w", "quaternion.x", "quaternion.y", "quaternion.z"),
    "imu_angular_velocity": ("gyro.x", "gyro.y", "gyro.z"),
    "imu_linear_acceleration": ("acceleration.x", "acceleration.y", "acceleration.z"),
}


@RobotConfig.register_subclass("humanoid_sim")
@dataclass(kw_only=True)
class HumanoidSimConfig(RobotConfig):
    """A running session in mode REMOTE."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    """LeRobot's cameras, by name."""
    velocities: bool = False
    """Observe the joints' velocities too, rad/s."""
    efforts: bool = False
    """Observe the joints' efforts too, N·m."""
    imu: bool = False
    """Observe the IMU too: quaternion w x y z, rad/s, m/s²."""
    max_joint_speed: float = 2.0
    """rad/s at which the joints follow an action, at most."""
    wait_s: float = 0.0
    """s for which `connect` waits for REMOTE and sends the present pose, which a robot with a free base needs."""


class HumanoidSim(Robot):
    """A session in mode REMOTE, simulated or on motors: modes are the operator's, limits and guards the session's."""

    config_class = HumanoidSimConfig
    name = "humanoid_sim"
    is_calibrated = True  # calibration, gains and limits are the session's

    def __init__(self, config: HumanoidSimConfig) -> None:
        """Attach to the session's feed, which knows the joints. Raises `SessionError` if there is no such session."""
        super().__init__(config)
        self.config = config
        self._session = find_session(config.session)
        self._feed = Feed(self._session)
        self._description = RobotDescription.from_json(self._feed.document("robot"))
        self._intake: Intake | None = None
        self._sent = 0.0  # s, when the latest command was
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
        cameras = {name: (camera.height, camera.width, 3) for name, camera in self.config.cameras.items()}
        return {name: float for names in self._values.values() for name in names} | cameras

    @cached_property
    def action_features(self) -> dict[str, type]:
        return {f"{joint}.pos": float for joint in self._feed.joint_names}

    @property
    def is_connected(self) -> bool:
        return self._intake is not None

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...

    def connect(self, calibrate: bool = True) -> None:
        """Start the cameras, and send actions from now on. Raises `DeviceNotConnectedError` in any mode but REMOTE."""
        if self._intake is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        self._intake = Intake(self._session, "lerobot")
        try:
            end = time.monotonic() + self.config.wait_s
            while (tick := self._tick())["mode"] != Mode.REMOTE and time.monotonic() < end:
                self._send(_commanded(tick))
                time.sleep(0.02)
            self._remote_tick()
            for camera in self.cameras.values():
                camera.connect()
        except BaseException:
            self.disconnect()
            raise

    def get_observation(self) -> dict[str, Any]:
        """Return the newest tick's values and the newest pictures."""
        tick, observation = self._tick(), {}
        for name, values in self._values.items():
            observation |= zip(values, map(float, tick[name]), strict=True)
        return observation | {name: camera.read_latest() for name, camera in self.cameras.items()}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Command joint positions, rad, and return what was sent. Raises `DeviceNotConnectedError` outside REMOTE."""
        tick = self._remote_tick()
        goal = np.array([float(action[name]) for name in self.action_features])
        if not np.isfinite(goal).all():
            raise ValueError(f"action: is {action}, expected finite numbers")
        commanded, reach = _commanded(tick), self.config.max_joint_speed * min(time.monotonic() - self._sent, _LONGEST)
        position = commanded + np.clip(goal - commanded, -reach, reach)
        self._send(position)
        return dict(zip(self.action_features, position.tolist(), strict=True))

    def disconnect(self) -> None:
        """Send no more: the session's passive hold follows, in the mode that it is in."""
        if self._intake is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        self._intake.close()
        self._intake = None
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()

    def _send(self, position: np.ndarray) -> None:
        assert self._intake is not None
        robot, zeros = self._description, [0.0] * len(position)
        gains = robot.stiffness.tolist(), robot.damping.tolist()
        self._intake.remote(robot.joint_names, position.tolist(), zeros, zeros, *gains)
        self._sent = time.monotonic()

    def _tick(self) -> dict[str, Any]:
        if self._intake is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        sample = self._feed.latest() or self._feed.wait(0, 1.0)
        if sample is None or not self._feed.is_running():
            raise DeviceNotConnectedError(f"{self._session}: has ended")
        return self._feed.decode(sample)

    def _remote_tick(self) -> dict[str, Any]:
        tick = self._tick()
        if tick["mode"] != Mode.REMOTE:
            how = "an operator enters it from STANDBY (python -m humanoid_sim.mode load_b, then start_remote)"
            mode = Mode(tick["mode"]).name
            raise DeviceNotConnectedError(f"{self._session}: is in {mode}, expected REMOTE; {how}")
        return tick


def _commanded(tick: dict[str, Any]) -> np.ndarray:
    """Return the joint positions that the session commands, rad; where it commands none, the measured ones."""
    return np.where(np.isfinite(tick["command_position"]), tick["command_position"], tick["joint_position"])
