"""Schema of a robot: its joints, limits, gains, motors, poses and rates. Data only; nothing here imports a simulator.

A description is one YAML file beside its MJCF model (`assets/robots/lite.yaml` is the example). These structs are its
schema, `humanoid_sim.robots.checks` what has to hold between fields, `humanoid_sim.robots.description.load_robot` reads
it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import msgspec

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import blaming
from humanoid_sim.mit import FloatArray, frozen_array


@dataclass(frozen=True, slots=True)
class Accepted:
    """Numbers that a field accepts, or texts: these must not be empty."""

    minimum: float = -math.inf
    above: bool = False
    """True where the minimum itself is refused."""
    below: float = math.inf
    """Least number that is too large."""

    def problem(self, value: float | str) -> str:
        """Return what is wrong with a value, '' if nothing is."""
        if isinstance(value, str):
            return "" if value.strip() else "is empty, expected a text"
        is_enough = value > self.minimum or (value == self.minimum and not self.above)
        if math.isfinite(value) and is_enough and value < self.below:
            return ""
        if isinstance(value, int):
            most = "" if self.below == math.inf else f", less than {self.below:.0f}"
            return f"is {value}, expected at least {self.minimum:g}{most}"
        bound = "" if self.minimum == -math.inf else f" {'>' if self.above else '>='} {self.minimum:g}"
        most = "" if self.below == math.inf else f" and < {self.below:g}"
        return f"is {value}, expected a finite number{bound}{most}"


Text = Annotated[str, Accepted()]
Finite = Annotated[float, Accepted()]
NotNegative = Annotated[float, Accepted(0.0)]
Positive = Annotated[float, Accepted(0.0, above=True)]


class MotorDescription(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The motor that drives a joint, and where it is on the bus."""

    family: Text = "robstride"
    """A key of `humanoid_sim.robots.motors.FAMILIES`: whose protocol it speaks."""
    bus: int
    """0-based index into the robot's buses."""
    can_id: int
    """1 to 127; a Sito's up to 255 where it is among its own."""
    model: Text
    """Such as `rs-02`."""
    direction: Literal[-1, 1]
    """Sign between motor and joint frame: a fact of the design, not of one physical robot."""
    torque_limit: NotNegative | None = None
    """N·m, written to the firmware, up to its data sheet's peak; 0: leave the firmware's own. Needed where the family
    has such a limit."""
    current_limit: NotNegative | None = None
    """A, written to the firmware; 0: leave the firmware's own. Likewise."""


class JointDynamics(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """Motor and gear of one joint as they were measured, instead of the MJCF's."""

    armature: NotNegative | None = None
    """kg·m², inertia of motor and gear at the joint; none, here and below: what the MJCF has."""
    friction: NotNegative | None = None
    """N·m, dry friction."""
    damping: NotNegative | None = None
    """N·m·s/rad, viscous friction: it acts whatever `joint_damping` says of the MJCF's."""
    torque_scale: Positive = 1.0
    """Torque at the joint over the one that the motor means to give and reports, its limit included."""
    delay: NotNegative = 0.0
    """s from a command to its effect. Emulated motors have each their own, simulations the mean of all joints."""


class JointDescription(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One actuated joint, in the joint frame."""

    name: Text
    """The joint's name in the MJCF, in policies and in every file."""
    lower: Finite
    """rad"""
    upper: Finite
    """rad"""
    effort_limit: Positive
    """N·m, at which the MIT law saturates: the hardware's. Infinite where a user's MJCF gives none."""
    stiffness: NotNegative
    """N·m/rad, default K_p."""
    damping: NotNegative
    """N·m·s/rad, default K_d."""
    motor: MotorDescription | None = None
    """None: this joint exists in simulation only."""
    dynamics: JointDynamics | None = None
    """Measured dynamics; none: those of the MJCF, and a motor that does at once what it is told."""


class BaseSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base that carries the robot."""

    type: Literal["fixed", "floating"] = "fixed"
    """`fixed`: welded to the world, as the Lite's chest is; `floating`: the base moves freely, and may fall."""
    body: str = ""
    """The MJCF body with the free joint of a floating base."""
    height: Finite | None | None = None
    """m, of the origin of a floating base above the world's origin where a simulation starts; none: such that the robot
    touches the floor in its initial position."""


class SimulationSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the robot in simulation."""

    physics_timestep: Positive = 0.0005
    """s"""
    control_frequency: Positive = 200.0
    """Hz"""
    floor_height: Finite = 0.0
    """m, world frame, height of the floor that the scene adds."""
    joint_damping: Literal["keep", "drop"] = "keep"
    """Fate of the damping that the MJCF itself gives the joints: it acts beside the commanded K_d, or it is 0.
    A policy's contract may decide otherwise."""


class HardwareSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the real robot."""

    control_frequency: Positive = 50.0
    """Hz"""
    rx_timeout_ms: Positive = 200.0
    """ms without a status of a joint after which RX_TIMEOUT is reported."""


class DampingSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters of `damping_controller`."""

    damping: tuple[NotNegative, ...] = ()
    """N·m·s/rad, one per joint; empty: `damping_scalar` for all."""
    damping_scalar: NotNegative = 1.0
    """N·m·s/rad"""


class StandbySettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters of one standby controller."""

    target_stiffness: tuple[NotNegative, ...]
    """N·m/rad, one per joint."""
    target_damping: tuple[NotNegative, ...]
    """N·m·s/rad, one per joint."""
    segment_durations: tuple[Positive, ...]
    """s, one per segment."""
    pose_segments: tuple[tuple[float, ...], ...]
    """rad, for each segment the pose at its end, one value per joint."""


class RemoteSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters of `remote_policy_controller`."""

    stale_command_policy: Literal["passive", "hold"] = "passive"
    stale_command_timeout_ms: Positive = 100.0
    """ms after its arrival at which a command is stale."""
    damping: tuple[NotNegative, ...] = ()
    """N·m·s/rad of the passive hold, one per joint; empty: `damping_scalar` for all."""
    damping_scalar: NotNegative | None = None
    """N·m·s/rad; none, and no `damping`: the passive hold damps as DAMPING does."""


class FollowingGuard(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A joint that is pulled hard must come nearer to where it is asked to be."""

    effort_share: Positive = 0.8
    """Share of the joint's effort limit: K_p times the error from which it is pulled hard."""
    effort: tuple[Positive | None, ...] = ()
    """N·m, one per joint, instead of that share; null: not watched. A floating base's robot keeps the shares of its own
    limits here where a policy's contract lowers them."""
    time: Positive | None = None
    """s; none: 0.15 with a fixed base, 0.3 with a floating one, whose legs carry it and strike the ground."""
    progress: Positive = 0.02
    """rad by which it must come nearer in that time."""


class LimitGuard(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A joint beyond its limits must not be pushed further out."""

    margin: Positive = 0.15
    """rad beyond `lower` or `upper`."""
    time: NotNegative = 0.1
    """s for which it may be."""


class SpeedGuard(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A joint must not be faster than its limit."""

    limit: tuple[Positive, ...] = ()
    """rad/s, one per joint; empty: derived from each joint's range and motor, see `robots.guards`. One beyond what the
    joint's motor can report is lowered to that."""
    time: NotNegative = 0.02
    """s for which it may be."""


class GuardSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Guards of the joints while a controller drives them; `null` turns a guard off."""

    following: FollowingGuard | None = FollowingGuard()
    limit: LimitGuard | None = LimitGuard()
    speed: SpeedGuard | None = SpeedGuard()


class PianoSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The piano in front of the robot, whose keys are passive joints of its MJCF, and what the robot plays it with."""

    fingers: tuple[str, ...]
    """MJCF sites, in the middle of the round tips that strike keys: one a hand, the left hand's first."""
    key_force_limit: Positive
    """N, with which no key may be touched."""
    reach: tuple[tuple[int, int], ...]
    """Lowest and highest key of each finger, 0 is A0, 87 is C8."""

    @property
    def keys(self) -> frozenset[int]:
        """The keys of any finger."""
        return frozenset(key for low, high in self.reach for key in range(low, high + 1))


class _OfJoints:
    """A field of every joint as an array of shape (n,), read-only, in the order of `joints`."""

    def __init__(self, field: str) -> None:
        self._field = field

    def __get__(self, robot: RobotDescription, _: type[RobotDescription]) -> FloatArray:
        return frozen_array("RobotDescription", self._field, [getattr(joint, self._field) for joint in robot.joints])


class RobotDescription(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A robot. Every per-joint list and array is in the order of `joints`."""

    name: Text
    topic_prefix: str = ""
    """Prefix of its own ROS 2 topics, such as `lite` of `/lite/joint_states`; empty: its name."""
    mjcf: Text
    """The MJCF model's path, relative to the description's own folder."""
    joints: tuple[JointDescription, ...]
    initial_position: tuple[float, ...]
    """rad, one per joint: where a simulated robot starts, at rest under gravity."""
    imu: Text
    """The MJCF site or body whose frame is the IMU's."""
    base: BaseSettings = BaseSettings()
    hands: tuple[str, ...] = ()
    """MJCF bodies whose poses are tracked and reported."""
    simulation: SimulationSettings = SimulationSettings()
    hardware: HardwareSettings = HardwareSettings()
    damping_controller: DampingSettings = DampingSettings()
    standby_controller_a: StandbySettings
    standby_controller_b: StandbySettings
    remote_policy_controller: RemoteSettings = RemoteSettings()
    guards: GuardSettings = GuardSettings()
    piano: PianoSettings | None = None
    """Piano of a robot that plays one."""
    folder: str = ""
    """Folder where the description was read; empty: the folder of the shipped robots. Not part of the file."""

    @property
    def mjcf_path(self) -> Path:
        """The MJCF model's absolute path."""
        folder = Path(self.folder) if self.folder else asset_path("robots")
        return (folder / self.mjcf).resolve()

    @property
    def joint_count(self) -> int:
        """n, the number of joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints' names in order."""
        return tuple(joint.name for joint in self.joints)

    @property
    def is_floating(self) -> bool:
        """Return whether the base moves freely."""
        return self.base.type == "floating"

    @property
    def has_no_gains(self) -> bool:
        """Return whether no joint has K_p or K_d, as of a robot read from its MJCF: they are the policy's."""
        return not any(joint.stiffness or joint.damping for joint in self.joints)

    lower = _OfJoints("lower")
    """Shape (n,), rad, read-only: lower position limits."""
    upper = _OfJoints("upper")
    """Shape (n,), rad, read-only: upper position limits."""
    effort_limit = _OfJoints("effort_limit")
    """Shape (n,), N·m, read-only."""
    stiffness = _OfJoints("stiffness")
    """Shape (n,), N·m/rad, read-only: default K_p."""
    damping = _OfJoints("damping")
    """Shape (n,), N·m·s/rad, read-only: default K_d."""

    @property
    def torque_scale(self) -> FloatArray:
        """Shape (n,), read-only: torque at each joint over its motor's own; ones where nothing was measured."""
        scales = [1.0 if joint.dynamics is None else joint.dynamics.torque_scale for joint in self.joints]
        return frozen_array("RobotDescription", "torque_scale", scales)

    @property
    def delay(self) -> FloatArray:
        """Shape (n,), s, read-only: from a command to its effect; zeros where nothing was measured."""
        delays = [0.0 if joint.dynamics is None else joint.dynamics.delay for joint in self.joints]
        return frozen_array("RobotDescription", "delay", delays)

    @property
    def mode_damping(self) -> FloatArray:
        """Shape (n,), N·m·s/rad, read-only: K_d of DAMPING."""
        settings = self.damping_controller
        values = settings.damping or (settings.damping_scalar,) * self.joint_count
        return frozen_array("RobotDescription", "mode_damping", values)

    @property
    def passive_damping(self) -> FloatArray:
        """Shape (n,), N·m·s/rad, read-only: K_d of REMOTE's passive hold."""
        settings = self.remote_policy_controller
        values = settings.damping
        if not values:
            if settings.damping_scalar is None:
                return self.mode_damping
            values = (settings.damping_scalar,) * self.joint_count
        return frozen_array("RobotDescription", "passive_damping", values)

    def to_json(self) -> str:
        """Return the description as JSON on one line, without folder: what a recording keeps."""
        document = msgspec.to_builtins(self)
        del document["folder"]
        for joint in document["joints"]:
            if joint["dynamics"] is None:  # as in the documents of before there were any: digests stay comparable
                del joint["dynamics"]
        if self.guards == GuardSettings():  # likewise
            del document["guards"]
        for name, default in (("topic_prefix", ""), ("piano", None)):
            if getattr(self, name) == default:  # likewise
                del document[name]
        return msgspec.json.encode(document).decode()

    @classmethod
    def from_json(cls, text: str, folder: str = "") -> Self:
        """Read a description from `to_json`'s text; `folder` has its MJCF, empty for the shipped robots' folder.

        Raises `InputError` for any other text.
        """
        with blaming("robot description (JSON)", (msgspec.DecodeError, msgspec.ValidationError, RecursionError)):
            document = msgspec.json.decode(text)
            _restore_infinite(document)
            return msgspec.structs.replace(msgspec.convert(document, cls), folder=folder)


def _restore_infinite(document: Any) -> None:
    """JSON has no infinity: a limit that does not exist is written as null."""
    for joint in document.get("joints", ()) if isinstance(document, dict) else ():
        for name, value in (("lower", -math.inf), ("upper", math.inf), ("effort_limit", math.inf)):
            if isinstance(joint, dict) and name in joint and joint[name] is None:
                joint[name] = value
