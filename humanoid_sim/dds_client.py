"""Talk to a robot over DDS: read its state, command its joints in REMOTE. For programs outside the robot's session.

    with RobotClient("lite") as robot:
        while (state := robot.state()) is not None:
            robot.command(MITCommand(state.position, zeros, effort, zeros, damping))

It speaks to the bridge (`humanoid_sim.dds`) with nothing but the topics of the original ROS 2 stack, so it works with
that stack's robots too. Modes are not on DDS: `Intake.ask` of `humanoid_sim.client` asks a session of this machine.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

from humanoid_sim.errors import FieldError, blaming
from humanoid_sim.messages import ControlMode, Mode, SafetyStatus, StandbyState
from humanoid_sim.mit import FloatArray, MITCommand, frozen_array
from humanoid_sim.ros2 import topics as ros
from humanoid_sim.ros2.cdr import CdrError, decode
from humanoid_sim.ros2.dds.domain import LOOPBACK, Participant
from humanoid_sim.ros2.dds.endpoints import Reader, Writer
from humanoid_sim.ros2.messages import decode_safety_status, encode_mit_command, time_ns

_TOPICS = (
    ros.IMU_TOPIC, ros.CONTROL_MODE_TOPIC, *ros.STANDBY_TOPICS, ros.TF_TOPIC, ros.DESCRIPTION_TOPIC, ros.SAFETY_TOPIC
)  # fmt: skip
_DEPTH = 64  # messages that may come between two calls


@dataclass(frozen=True, slots=True, eq=False)
class JointStates:
    """The joints at one time; all arrays of shape (n,), read-only, in the order of `names`."""

    names: tuple[str, ...]
    position: FloatArray  # rad, joint frame; NaN for a joint that was never received
    velocity: FloatArray  # rad/s
    effort: FloatArray  # N·m
    time_ns: int  # the robot's stamp


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """Measurements of the IMU, in the body frame; arrays are read-only."""

    quaternion: FloatArray  # (4,), w x y z
    angular_velocity: FloatArray  # (3,), rad/s
    linear_acceleration: FloatArray  # (3,), m/s²
    time_ns: int  # the robot's stamp


class RobotClient:
    """A robot on DDS. A context manager; for one thread.

    What reads raises `InputError` for what this version does not know, and for a subscription that is broken.
    """

    def __init__(self, prefix: str = "lite", *, domain: int | None = None, interface: str = LOOPBACK) -> None:
        """Join the robot's domain, None for that of `ROS_DOMAIN_ID`, on the interface by which it is reached.

        `prefix` is what its joint states are under: `lite` for all Lites, otherwise the robot's name. Raises
        `InputError`.
        """
        self._participant = Participant(domain, interface)
        self._joint_topic = ros.joint_states_topic(prefix)
        topics = (*_TOPICS, self._joint_topic)
        self._readers = {topic: Reader(self._participant, topic, _DEPTH) for topic in topics}
        self._latest: dict[str, list[Any]] = {}
        """Values of the newest message, by topic."""
        self._safety: dict[str, SafetyStatus] = {}
        self.joint_names: tuple[str, ...] = ()
        """The robot's joints in its order; empty before the first state."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the domain. May be called twice."""
        self._participant.close()

    @cached_property
    def _writer(self) -> Writer:
        return Writer(self._participant, ros.COMMAND_TOPIC)

    def _newest(self, topic: str) -> list[Any] | None:
        """Return the values of the newest message, whenever it came; None while there is none."""
        for sample in self._readers[topic].take()[-1:]:
            with blaming(topic, CdrError):
                self._latest[topic] = decode(ros.topic_kind(topic).schema, sample.data)
        return self._latest.get(topic)

    def state(self, timeout: float = 1.0) -> JointStates | None:
        """Return the newest joint states that were not given yet; None if none come within `timeout` s."""
        deadline = time.monotonic() + timeout
        while (newest := self._newest(self._joint_topic)) is None:
            left = deadline - time.monotonic()
            if left <= 0.0:
                return None
            self._readers[self._joint_topic].wait(left)
        del self._latest[self._joint_topic]
        stamp, _, names, *arrays = newest
        self.joint_names = tuple(names)
        position, velocity, effort = (frozen_array("JointStates", "values", one) for one in arrays)
        return JointStates(self.joint_names, position, velocity, effort, time_ns(stamp))

    def command(self, command: MITCommand) -> bool:
        """Send a command for REMOTE, one value per joint in each field; True if sent.

        What is not repeated ends: 100 ms after the last command the robot damps its joints. Raises `FieldError` before
        the first state, or if its shape is not that of the robot's joints.
        """
        if command.position.shape != (len(self.joint_names),) or not self.joint_names:
            accepted = (
                f"({len(self.joint_names)},), one value per joint of the robot's state, which must have come before"
            )
            raise FieldError(f"MITCommand: has shape {command.position.shape}, expected {accepted}")
        return self._writer.write(encode_mit_command(time.time_ns(), self.joint_names, command))

    def control_mode(self) -> ControlMode | None:
        """Return the mode, who is in control, and the latest word to the operator; None before the first message."""
        newest = self._newest(ros.CONTROL_MODE_TOPIC)
        if newest is None:
            return None
        _, _, (mode,), controller, message = newest
        with blaming(ros.CONTROL_MODE_TOPIC, ValueError):
            return ControlMode(Mode(mode), controller, message)

    def imu(self) -> Imu | None:
        """Return the newest IMU sample; None before the first message."""
        newest = self._newest(ros.IMU_TOPIC)
        if newest is None:
            return None
        stamp, _, numbers = newest  # each vector is followed by the nine numbers of its covariance
        x, y, z, w = numbers[:4]
        vectors = (w, x, y, z), numbers[13:16], numbers[25:28]
        turn, gyro, acceleration = (frozen_array("Imu", "vectors", one) for one in vectors)
        return Imu(turn, gyro, acceleration, time_ns(stamp))

    def standby(self) -> StandbyState | None:
        """Return the progress of the latest standby pose; None before the first message."""
        newest = [self._newest(topic) for topic in ros.STANDBY_TOPICS]  # by pose, with a stamp first
        stamped = [values for values in newest if values is not None]
        return StandbyState(*max(stamped, key=lambda values: values[0])[-1]) if stamped else None

    def safety(self) -> Mapping[str, SafetyStatus]:
        """Return the latest status of each source, such as a CAN bus. A level beyond CRITICAL is CRITICAL."""
        for sample in self._readers[ros.SAFETY_TOPIC].take():
            with blaming(ros.SAFETY_TOPIC, CdrError):
                _, status = decode_safety_status(sample.data)
            self._safety[status.source] = status
        return dict(self._safety)

    def description(self) -> str | None:
        """Return the robot as URDF; None before the first message."""
        newest = self._newest(ros.DESCRIPTION_TOPIC)
        return None if newest is None else str(newest[0])

    def frame_pose(self, frame: str) -> FloatArray | None:
        """Return the pose of a frame in its parent's, shape (7,), m and w x y z; None if the newest `/tf` lacks it."""
        (transforms,) = self._newest(ros.TF_TOPIC) or ((),)
        for _, _, child, (x, y, z, *turn, w) in transforms:
            if child == frame:
                return frozen_array("frame_pose", frame, [x, y, z, w, *turn])
        return None
