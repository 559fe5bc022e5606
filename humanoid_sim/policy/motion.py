"""Reference motions on disk: one episode as an MCAP file of `std_msgs/msg/Float32MultiArray`, one message per frame.

A tracking frame of the layout `bodies_b` is `[positions 3·B | orientations 6·B]` in the base frame, metres; an
orientation is the first two columns of its rotation matrix, flattened row by row. One of the layout `joints_bodies_w`
is `[joint positions n | joint velocities n | positions 3·B | quaternions w x y z 4·B]`, rad, rad/s and metres, world
frame. A piano frame is the goal state of the keys, 0 or 1. Files of other writers are read too; the metadata record
`motion` (robot, body_names, joint_names, layout, policy_dt, task_type) is then missing. Of a recording the motion is
read that it was made with.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import CompressionType, Writer

from humanoid_sim.controllers.parameters import one_of
from humanoid_sim.controllers.rotation import rotation_6d, rotation_from_6d
from humanoid_sim.errors import FieldError, InputError, blaming, known_names
from humanoid_sim.files import regular_file
from humanoid_sim.mit import Float32Array, FloatArray
from humanoid_sim.policy.readers.own import csv
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.definitions import FLOAT32_MULTI_ARRAY, SCHEMA_ENCODING, schema_text
from humanoid_sim.ros2.mcap_stream import McapStream, Message
from humanoid_sim.ros2.messages import decode_float32_array, encode_float32_array

MotionLayout = Literal["bodies_b", "joints_bodies_w"]

MOTION_ATTACHMENT = "motion.mcap"
"""Name of the motion file inside a recording."""

_TOPIC = "/motion"
_LIBRARY = "humanoid_sim"
_NANOSECONDS = 1e9
_FRAME = f"{FLOAT32_MULTI_ARRAY} (cdr)"


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One episode of a reference motion, checked and read-only."""

    frames: Float32Array
    """Shape (F, width), one row per policy step, F ≥ 1; finite."""
    body_names: tuple[str, ...]
    """The B tracked bodies in the order of the frame; empty without bodies, or if the file does not say."""
    policy_dt: float
    """s between two frames."""
    task_type: str = "tracking"
    """`tracking`, `piano` or `locomotion`; empty if the file does not say."""
    robot: str = ""
    """The robot that the motion was made for; empty if the file does not say."""
    layout: MotionLayout = "bodies_b"
    """Content of a tracking frame."""
    joint_names: tuple[str, ...] = ()
    """The n joints of the layout `joints_bodies_w`, in the order of the frame."""

    def __post_init__(self) -> None:
        frames = np.array(self.frames, dtype=np.float32)
        if frames.ndim != 2 or 0 in frames.shape:
            raise FieldError(f"Motion.frames: shape is {frames.shape}, expected (F, width), both at least 1")
        bad = np.argwhere(~np.isfinite(frames))
        if len(bad):
            frame, index = (int(value) for value in bad[0])
            raise FieldError(f"Motion.frames: value {index} of frame {frame} is {frames[frame, index]}, not finite")
        one_of("Motion", "layout", self.layout, MotionLayout)
        width, bodies, joints = frames.shape[1], len(self.body_names), len(self.joint_names)
        if self.layout == "joints_bodies_w":
            expected = 2 * joints + 7 * bodies
        else:
            expected = 9 * bodies if bodies and self.task_type == "tracking" else width
        if width != expected:
            what = f"layout {self.layout} of {joints} joints and {bodies} bodies"
            raise FieldError(f"Motion.frames: {width} values per frame, expected {expected}: {what}")
        if not (np.isfinite(self.policy_dt) and self.policy_dt > 0.0):
            raise FieldError(f"Motion.policy_dt: is {self.policy_dt}, expected a positive number of seconds")
        frames.setflags(write=False)
        object.__setattr__(self, "frames", frames)

    @property
    def duration(self) -> float:
        """Time from the first frame to the last, s."""
        return (len(self.frames) - 1) * self.policy_dt


def body_frames(position: FloatArray, rotation: FloatArray) -> FloatArray:
    """Frames (F, 9 B) of the layout `bodies_b`.

    Args:
        position: shape (F, B, 3), m, base frame.
        rotation: shape (F, B, 3, 3), base frame.
    """
    count = len(position)
    return np.concatenate([position.reshape(count, -1), rotation_6d(rotation).reshape(count, -1)], axis=1)


def body_poses(frames: npt.NDArray[np.floating], count: int) -> tuple[FloatArray, FloatArray]:
    """Positions (F, B, 3), m, and rotation matrices (F, B, 3, 3), base frame, in frames (F, 9 B) of `count` bodies."""
    values = np.asarray(frames, dtype=np.float64)
    rotation = rotation_from_6d(values[:, 3 * count :].reshape(-1, count, 6))
    return values[:, : 3 * count].reshape(-1, count, 3), rotation


def read_motion(path: str | os.PathLike[str], topic: str | None = None) -> Motion:
    """Read and check a motion file, a recording, or a folder of rosbag2.

    Raises `InputError` with the file and what is wrong with it.

    Args:
        topic: of the motion, where there are others; None: it has to be the only one.
    """
    path = Path(path)
    # rosbag2 numbers its files; the shorter name is the lower number.
    files = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
    if not files:
        files = [regular_file(path, "a motion file (.mcap) or a folder of rosbag2 with MCAP files", None)]
    with ExitStack() as opened, blaming(f"{path}: cannot be read", OSError):
        return _motion(path, [McapStream(opened.enter_context(file.open("rb"))) for file in files], topic)


def parse_motion(data: bytes, name: str) -> Motion:
    """Return a motion from the bytes of its file; `name` is what to call it in messages."""
    return _motion(Path(name), [McapStream(BytesIO(data))], None)


def _motion(path: Path, streams: Sequence[McapStream], topic: str | None) -> Motion:
    kinds: dict[str, str] = {}
    frames: dict[str, list[Message]] = {}
    metadata: Mapping[str, str] = {}
    attached = b""  # a recording has the motion that it was made with: the last one, of the policy loaded last
    for stream in streams:
        schemas: dict[int, str] = {}
        channels: dict[int, str] = {}
        for record in stream:
            if isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                channels[record.id] = record.topic
                kinds[record.topic] = f"{schemas.get(record.schema_id, 'no schema')} ({record.message_encoding})"
            elif isinstance(record, Message) and kinds.get(channels.get(record.channel_id, "")) == _FRAME:
                frames.setdefault(channels[record.channel_id], []).append(record)
            elif isinstance(record, Metadata) and record.name == "motion":
                metadata = record.metadata
            elif isinstance(record, Attachment) and record.name == MOTION_ATTACHMENT:
                attached = record.data
    if attached and topic is None:
        return parse_motion(attached, str(path))
    for stream in streams:
        if stream.damage:
            raise InputError(f"{path}: {stream.damage}")
    with blaming(path):
        return _episode(frames.get(_frame_topic(kinds, topic), []), metadata)


def _episode(messages: Sequence[Message], metadata: Mapping[str, str]) -> Motion:
    if not messages:
        raise FieldError("the topic holds no frames")
    times = [message.log_time for message in messages]
    rows: list[Float32Array] = []
    for i, message in enumerate(messages):
        with blaming(f"frame {i} is not a {FLOAT32_MULTI_ARRAY}", CdrError, FieldError):
            rows.append(decode_float32_array(message.data))
        if len(rows[i]) != len(rows[0]):
            raise FieldError(f"frame {i} has {len(rows[i])} values, the frames before {len(rows[0])}")
        if i and times[i] < times[i - 1]:
            raise FieldError(f"time goes back at frame {i}; a motion file holds one episode")
    return Motion(
        frames=np.stack(rows),
        body_names=tuple(csv(metadata.get("body_names", ""))),
        policy_dt=_policy_dt(metadata, times),
        task_type=metadata.get("task_type", ""),
        robot=metadata.get("robot", ""),
        layout=metadata.get("layout", "bodies_b"),  # type: ignore[arg-type]  # checked at construction
        joint_names=tuple(csv(metadata.get("joint_names", ""))),
    )


def _frame_topic(kinds: Mapping[str, str], topic: str | None) -> str:
    """Return the topic of the frames; None: the only one."""
    if topic is None and len(kinds) != 1:
        listed = ", ".join(f"'{name}' {kind}" for name, kind in kinds.items()) or "no topics"
        raise FieldError(f"has {listed}, expected one topic of {_FRAME}; `play --motion-topic` takes one of several")
    name = next(iter(kinds)) if topic is None else topic
    if name not in kinds:
        raise FieldError(known_names("topic", name, kinds))
    if kinds[name] != _FRAME:
        raise FieldError(f"topic '{name}' is {kinds[name]}, expected {_FRAME}")
    return name


def _policy_dt(metadata: Mapping[str, str], times: list[int]) -> float:
    """Return the frame period in s: as the file says it, or, if it does not, as its evenly spaced log times show it."""
    text = metadata.get("policy_dt")
    if text is not None:
        with blaming(f"policy_dt: is '{text}', expected a positive number of seconds", ValueError, FieldError):
            return float(text)
    steps = np.diff(times)
    if len(steps) == 0 or steps.min() <= 0 or steps.max() - steps.min() > 0.01 * steps.mean():
        raise FieldError("policy_dt: not in the metadata record 'motion', and the frames are not evenly spaced in time")
    return float(round(steps.mean())) / _NANOSECONDS


def motion_bytes(motion: Motion) -> bytes:
    """Return a motion file's bytes; the same motion gives the same."""
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.LZ4)
    # The library's name without its version: the bytes must not change with an update of it.
    writer.start(profile="ros2", library=_LIBRARY)
    metadata = {
        "robot": motion.robot,
        "body_names": ",".join(motion.body_names),
        "policy_dt": repr(motion.policy_dt),
        "task_type": motion.task_type,
    }
    if motion.layout != "bodies_b":  # the usual layout goes without saying, as in files of older versions
        metadata |= {"layout": motion.layout, "joint_names": ",".join(motion.joint_names)}
    writer.add_metadata("motion", metadata)
    schema = writer.register_schema(FLOAT32_MULTI_ARRAY, SCHEMA_ENCODING, schema_text(FLOAT32_MULTI_ARRAY).encode())
    channel = writer.register_channel(_TOPIC, "cdr", schema)
    for index, frame in enumerate(motion.frames):
        time = round(index * motion.policy_dt * _NANOSECONDS)
        writer.add_message(channel, time, encode_float32_array(frame), time, index)
    writer.finish()
    return stream.getvalue()
