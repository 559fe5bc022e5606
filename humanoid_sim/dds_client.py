"""Talk to a robot over DDS: read its state, command its joints in REMOTE. For programs outside the robot's session.

    with RobotClient("lite") as robot:
        while (state := robot.state()) is not None:
            robot.command(MITCommand(state.position, zeros, effort, zeros, damping))

It speaks to the bridge (`humanoid_sim.dds`) with nothing but the topics of the original ROS 2 stack, so it works with
that stack's robots too. Modes are not on DDS: `RobotClient.ask` asks a session of this machine.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

from humanoid_sim.client import Answer, Intake, find_session
from humanoid_sim.errors import FieldError, blaming
from humanoid_sim.messages import ControlMode, Mode, SafetyStatus, StandbyState
from humanoid_sim.mit import FloatArray, MITCommand, frozen_array
from humanoid_sim.ros2 import topics as ros
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.dds.domain import LOOPBACK, Participant
from humanoid_sim.ros2.dds.endpoints import Reader, Subscription, Writer
from humanoid_sim.ros2.messages import decode_safety_status, encode_mit_command

_LATEST = (ros.IMU_TOPIC, ros.CONTROL_MODE_TOPIC, ros.STANDBY_TOPIC, ros.TF_TOPIC, ros.DESCRIPTION_TOPIC)
_STATUSES = 64  # that may come between two calls


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


def _stamp_ns(message: Mapping[str, Any]) -> int:
    stamp = message["header"]["stamp"]
    return int(stamp["sec"]) * 1_000_000_000 + int(stamp["nanosec"])


class RobotClient:
    """A robot on DDS. A context manager; for one thread.

    What reads raises `InputError` for what this version does not know, and for a subscription that is broken.
    """

    def __init__(self, prefix: str = "lite", *, domain: int | None = None, interface: str = LOOPBACK) -> None:
        """Join the robot's domain. Raises `InputError`.

        Args:
            prefix: what its joint states are under: `lite` for all Lites, otherwise the robot's name.
            domain: its id; None for that of `ROS_DOMAIN_ID`.
            interface: network interface by which the robot is reached; `lo` for a robot on this machine.
        """
        self._participant = Participant(domain, interface)
        self._states = Subscription(self._participant, ros.joint_states_topic(prefix))
        self._topics = {name: Subscription(self._participant, name) for name in _LATEST}
        self._statuses = Reader(self._participant, ros.SAFETY_TOPIC, _STATUSES)
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

    def state(self, timeout: float = 1.0) -> JointStates | None:
        """Return the newest joint states that were not given yet; None if none come within `timeout` s."""
        deadline = time.monotonic() + timeout
        while not (messages := self._states.take()):
            left = deadline - time.monotonic()
            if left <= 0.0:
                return None
            self._states.reader.wait(left)
        newest = messages[-1]
        self.joint_names = tuple(newest["name"])
        names = ("position", "velocity", "effort")
        position, velocity, effort = (frozen_array("JointStates", name, newest[name]) for name in names)
        return JointStates(self.joint_names, position, velocity, effort, _stamp_ns(newest))

    def command(self, command: MITCommand) -> bool:
        """Send a command for REMOTE, one value per joint in each field; True if sent.

        What is not repeated ends: 100 ms after the last command the robot damps its joints. Raises `FieldError` before
        the first state, or if its shape is not that of the robot's joints.
        """
        if command.position.shape != (len(self.joint_names),) or not self.joint_names:
            raise FieldError(
                f"MITCommand: has shape {command.position.shape}, expected ({len(self.joint_names)},), one value per "
                "joint of the robot's state, which must have come before"
            )
        return self._writer.write(encode_mit_command(time.time_ns(), self.joint_names, command))

    def control_mode(self) -> ControlMode | None:
        """Return the mode, who is in control, and the latest word to the operator; None before the first message."""
        message = self._topics[ros.CONTROL_MODE_TOPIC].look()
        if message is None:
            return None
        with blaming(ros.CONTROL_MODE_TOPIC, ValueError):
            return ControlMode(Mode(message["mode"]), message["controller_name"], message["status_message"])

    def imu(self) -> Imu | None:
        """Return the newest IMU sample; None before the first message."""
        message = self._topics[ros.IMU_TOPIC].look()
        if message is None:
            return None
        fields = (("orientation", "wxyz"), ("angular_velocity", "xyz"), ("linear_acceleration", "xyz"))
        turn, gyro, acceleration = (
            frozen_array("Imu", name, [message[name][axis] for axis in axes]) for name, axes in fields
        )
        return Imu(turn, gyro, acceleration, _stamp_ns(message))

    def standby(self) -> StandbyState | None:
        """Return the progress of the latest standby pose; None before the first message."""
        message = self._topics[ros.STANDBY_TOPIC].look()
        fields = ("current_segment", "total_segments", "progress", "is_finished")
        return None if message is None else StandbyState(*(message[name] for name in fields))

    def safety(self) -> Mapping[str, SafetyStatus]:
        """Return the latest status of each source, such as a CAN bus. A level beyond CRITICAL is CRITICAL."""
        for sample in self._statuses.take():
            with blaming(ros.SAFETY_TOPIC, CdrError):
                _, status = decode_safety_status(sample.data)
            self._safety[status.source] = status
        return dict(self._safety)

    def description(self) -> str | None:
        """Return the robot as URDF; None before the first message."""
        message = self._topics[ros.DESCRIPTION_TOPIC].look()
        return None if message is None else str(message["data"])

    def frame_pose(self, frame: str) -> FloatArray | None:
        """Return the pose of a frame in its parent's, shape (7,), m and w x y z; None if the newest `/tf` lacks it."""
        message = self._topics[ros.TF_TOPIC].look() or {"transforms": ()}
        for one in message["transforms"]:
            if one["child_frame_id"] == frame:
                where, turn = one["transform"]["translation"], one["transform"]["rotation"]
                pose = [*(where[axis] for axis in "xyz"), *(turn[axis] for axis in "wxyz")]
                return frozen_array("frame_pose", frame, pose)
        return None

    def ask(self, word: str, timeout: float = 2.0) -> Answer:
        """Ask the session that runs on this machine for a mode: `damp`, `load_a`, `start_remote`, ...

        No mode crosses a network. Raises `SessionError` if there is no session here, or several.
        """
        with Intake(find_session(), "dds client") as intake:
            return intake.ask(word, timeout)
