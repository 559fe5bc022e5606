"""Options of the robot, `--robot.…`, and of its rendered cameras."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig


@CameraConfig.register_subclass("humanoid_sim")
@dataclass(kw_only=True)
class HumanoidSimCameraConfig(CameraConfig):
    """Pictures of the session's model, drawn as they are read."""

    fps: int | None = 30
    width: int | None = 320
    """Pixels."""
    height: int | None = 240
    """Pixels."""
    view: str = "outside"
    """`outside`, from the front; `ego`, from the head; or the name of a camera in the robot's MJCF."""
    session: int | None = None
    """Process id of the session. Default: the robot's."""


@RobotConfig.register_subclass("humanoid_sim")
@dataclass(kw_only=True)
class HumanoidSimConfig(RobotConfig):
    """A running session in mode REMOTE."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    """Cameras by name: type `humanoid_sim`, or any of LeRobot's own."""
    velocities: bool = False
    """Observe the joints' velocities too, rad/s."""
    efforts: bool = False
    """Observe the joints' efforts too, N·m."""
    imu: bool = False
    """Observe the IMU too: quaternion w x y z, rad/s, m/s²."""
    approach_speed: float = 1.0
    """rad/s at which the joints come from where they are to the first action, and to the next one after a pause."""
    wait_s: float = 0.0
    """s for which `connect` waits for REMOTE, sending the present pose meanwhile: a robot with a free base is given to
    REMOTE only while a producer sends."""
