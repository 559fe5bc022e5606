"""Schema of a robot's description, one YAML file beside its MJCF, such as `assets/robots/lite.yaml`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Literal, Self

import msgspec
import numpy as np

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.mit import FloatArray

Text = Annotated[str, msgspec.Meta(min_length=1)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
_MOST_STEPS = 10_000  # of one period: more would take seconds to compute
Key = Annotated[int, msgspec.Meta(ge=0, le=87)]  # 0 is A0, 87 is C8


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pass


class MotorDescription(_Part, frozen=True, kw_only=True, omit_defaults=True):
    """The motor that drives a joint, and where it is on the bus."""

    bus: Annotated[int, msgspec.Meta(ge=0)]  # channels are given in the order of these numbers
    can_id: int  # 1 to 127; a Sito's up to 255 where all motors are Sitos
    model: Text  # key of `humanoid_sim.robots.motors.MOTORS`, such as `rs-02`
    direction: Literal[-1, 1]  # sign between motor and joint frame: of the design, not of one physical robot
    family: str = ""  # the model's, or empty
    torque_limit: NotNegative | None = None  # N·m, written to the firmware, if the family has one; 0 leaves its own
    current_limit: NotNegative | None = None  # A, likewise


class JointDynamics(_Part, frozen=True, omit_defaults=True):
    """Measured motor and gear of one joint, instead of the MJCF's; None leaves the MJCF's."""

    armature: NotNegative | None = None  # kg·m², inertia of motor and gear at the joint
    friction: NotNegative | None = None  # N·m, dry friction
    damping: NotNegative | None = None  # N·m·s/rad, viscous friction, whatever `joint_damping` says of the MJCF's
    torque_scale: Positive = 1.0  # torque at the joint over the torque that the motor reports
    delay: NotNegative = 0.0  # s from a command to its effect; simulations have the mean of all joints


class JointDescription(_Part, frozen=True):
    """One actuated joint, in the joint frame. Limits are infinite where a user's MJCF gives none."""

    name: Text  # in the MJCF, in policies and in every file
    lower: float  # rad
    upper: float  # rad
    effort_limit: Positive  # N·m, the hardware's, at which the MIT law saturates
    stiffness: NotNegative  # N·m/rad, default K_p
    damping: NotNegative  # N·m·s/rad, default K_d
    motor: MotorDescription | None = None  # None: this joint exists in simulation only
    dynamics: JointDynamics | None = None


class BaseSettings(_Part, frozen=True):
    """Base that carries the robot: welded to the world (`fixed`), or free to move and to fall (`floating`)."""

    type: Literal["fixed", "floating"] = "fixed"
    body: str = ""  # the MJCF body with the free joint of a floating base
    height: float | None = None  # m above the world's origin at the start; None: its lowest part touches the floor


class SimulationSettings(_Part, frozen=True):
    """Settings of the simulated robot."""

    physics_timestep: Positive = 0.0005  # s
    control_frequency: Positive = 200.0  # Hz
    floor_height: float = 0.0  # m, world frame, of the floor that the scene adds
    joint_damping: Literal["keep", "drop"] = "keep"  # the MJCF's own, beside K_d; a contract may decide otherwise


class HardwareSettings(_Part, frozen=True):
    """Settings of the real robot."""

    control_frequency: Positive = 50.0  # Hz
    # ms without a status of a joint after which RX_TIMEOUT is reported
    rx_timeout_ms: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] = 200.0
    # The IMU's own axes in the robot's IMU frame, w x y z; by default label up, x forward.
    imu_mounting: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 0.0)


class DampingSettings(_Part, frozen=True):
    """Parameters of `damping_controller`."""

    damping: tuple[NotNegative, ...] = ()  # N·m·s/rad, one per joint; empty: `damping_scalar` for all
    damping_scalar: NotNegative = 1.0  # N·m·s/rad


class StandbySettings(_Part, frozen=True):
    """Parameters of one standby controller."""

    target_stiffness: tuple[NotNegative, ...]  # N·m/rad, one per joint
    target_damping: tuple[NotNegative, ...]  # N·m·s/rad, one per joint
    segment_durations: Annotated[tuple[Positive, ...], msgspec.Meta(min_length=1)]  # s
    pose_segments: tuple[tuple[float, ...], ...]  # rad, for each segment the pose at its end, one value per joint


class RemoteSettings(_Part, frozen=True):
    """Parameters of `remote_policy_controller`."""

    stale_command_policy: Literal["passive", "hold"] = "passive"
    stale_command_timeout_ms: Positive = 100.0  # ms after its arrival
    damping: tuple[NotNegative, ...] = ()  # N·m·s/rad of the passive hold, one per joint; empty: `damping_scalar`
    damping_scalar: NotNegative | None = None  # N·m·s/rad; None: as DAMPING


class GuardSettings(_Part, frozen=True):
    """Guards of the joints while a controller drives them; null in `following`, `limit` or `speed` turns it off."""

    following: Positive | None = 0.8  # of the effort limit: K_p times the error from which a joint must come nearer
    following_effort: tuple[Positive | None, ...] = ()  # N·m, one per joint, instead of that share; null: not watched
    following_time: Positive | None = None  # s; None: 0.15 with a fixed base, 0.3 with a floating one
    following_progress: Positive = 0.02  # rad by which it must come nearer in that time
    limit: Positive | None = 0.15  # rad beyond `lower` or `upper` where a joint must not be pushed further out
    limit_time: NotNegative = 0.1  # s
    speed: tuple[Positive, ...] | None = ()  # rad/s, one per joint; empty: from range and motor, see `robots.guards`
    speed_time: NotNegative = 0.02  # s


class PianoSettings(_Part, frozen=True):
    """The piano in front of the robot, whose keys are passive joints of its MJCF, and what the robot plays it with."""

    fingers: tuple[str, str]  # MJCF sites in the middle of the tips that strike keys, the left hand's first
    key_force_limit: Positive  # N, with which no key may be touched
    reach: tuple[tuple[Key, Key], tuple[Key, Key]]  # lowest and highest key of each finger

    @property
    def keys(self) -> frozenset[int]:
        return frozenset(key for low, high in self.reach for key in range(low, high + 1))


def _array(values: Iterable[float]) -> FloatArray:
    array = np.fromiter(values, np.float64)
    array.setflags(write=False)
    return array


class _PerJoint:
    def __init__(self, value: Callable[[JointDescription], float]) -> None:
        self._value = value

    def __get__(self, robot: RobotDescription, _: type[RobotDescription]) -> FloatArray:
        return _array(map(self._value, robot.joints))


class RobotDescription(_Part, frozen=True, kw_only=True):
    """A robot. Every per-joint list and array is in the order of `joints`."""

    name: Text
    topic_prefix: str = ""  # of its own ROS 2 topics, such as `lite` of `/lite/joint_states`; empty: its name
    mjcf: Text  # path relative to the description's own folder
    joints: Annotated[tuple[JointDescription, ...], msgspec.Meta(min_length=1)]
    initial_position: tuple[float, ...]  # rad, one per joint: where a simulated robot starts, at rest under gravity
    imu: Text  # the MJCF site or body whose frame is the IMU's
    base: BaseSettings = BaseSettings()
    hands: tuple[str, ...] = ()  # MJCF bodies whose poses are tracked and reported
    simulation: SimulationSettings = SimulationSettings()
    hardware: HardwareSettings = HardwareSettings()
    damping_controller: DampingSettings = DampingSettings()
    standby_controller_a: StandbySettings
    standby_controller_b: StandbySettings
    remote_policy_controller: RemoteSettings = RemoteSettings()
    guards: GuardSettings = GuardSettings()
    piano: PianoSettings | None = None
    folder: str = ""  # where the description was read; empty: the folder of the shipped robots. Not part of the file

    lower = _PerJoint(lambda joint: joint.lower)  # rad
    upper = _PerJoint(lambda joint: joint.upper)  # rad
    effort_limit = _PerJoint(lambda joint: joint.effort_limit)  # N·m
    stiffness = _PerJoint(lambda joint: joint.stiffness)  # N·m/rad, default K_p
    damping = _PerJoint(lambda joint: joint.damping)  # N·m·s/rad, default K_d
    torque_scale = _PerJoint(lambda joint: joint.dynamics.torque_scale if joint.dynamics else 1.0)
    delay = _PerJoint(lambda joint: joint.dynamics.delay if joint.dynamics else 0.0)  # s

    @property
    def mjcf_path(self) -> Path:
        folder = Path(self.folder) if self.folder else asset_path("robots")
        return (folder / self.mjcf).resolve()

    @property
    def joint_count(self) -> int:
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    @property
    def is_floating(self) -> bool:
        return self.base.type == "floating"

    @property
    def has_no_gains(self) -> bool:
        """True if no joint has K_p or K_d: they are the policy's."""
        return not (self.stiffness.any() or self.damping.any())

    @property
    def mode_damping(self) -> FloatArray:
        """Shape (n,), N·m·s/rad: K_d of DAMPING."""
        settings = self.damping_controller
        return _array(settings.damping or (settings.damping_scalar,) * self.joint_count)

    @property
    def passive_damping(self) -> FloatArray:
        """Shape (n,), N·m·s/rad: K_d of REMOTE's passive hold."""
        settings = self.remote_policy_controller
        if not settings.damping and settings.damping_scalar is None:
            return self.mode_damping
        return _array(settings.damping or (settings.damping_scalar or 0.0,) * self.joint_count)

    def to_json(self) -> str:
        """Return the description as JSON on one line, without folder: what a recording keeps."""
        document = msgspec.to_builtins(self)
        del document["folder"]
        return msgspec.json.encode(document).decode()

    @classmethod
    def from_json(cls, text: str, folder: str = "") -> Self:
        """Read a description from `to_json`'s text; `folder` has its MJCF, empty for the shipped robots' folder."""
        no_limit = {"lower": -math.inf, "upper": math.inf, "effort_limit": math.inf}  # null in JSON
        with blaming("robot description (JSON)", (msgspec.MsgspecError, KeyError, TypeError)):
            document = msgspec.json.decode(text)
            for joint in document["joints"]:
                joint.update({name: value for name, value in no_limit.items() if joint[name] is None})
            return msgspec.convert({**document, "folder": folder}, cls)


def steps_per_period(period: float, step: float) -> int:
    """Return how many steps of `step` make up `period`; both in s. Raises `InputError` if that is no whole number."""
    count = max(round(period / step), 1) if step > 0.0 else 0
    if not 0 < count <= _MOST_STEPS or abs(period / step - count) > 1e-9 * count:
        near = f", such as {period / min(max(count, 1), _MOST_STEPS):g} s"
        raise InputError(f"physics_timestep: {step:g} s does not divide the control period of {period:g} s{near}")
    return count
