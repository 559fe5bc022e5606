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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import CompressionType, Writer

from humanoid_sim.controllers.rotation import rotation_6d, rotation_from_6d
from humanoid_sim.errors import FieldError, InputError, blaming, known_names
from humanoid_sim.files import regular_file
from humanoid_sim.mit import Float32Array, FloatArray
from humanoid_sim.policy.readers.values import names
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.definitions import FLOAT32_MULTI_ARRAY, SCHEMA_ENCODING, schema_text
from humanoid_sim.ros2.mcap_stream import McapStream, Message
from humanoid_sim.ros2.messages import decode_float32_array, encode_float32_array
from humanoid_sim.strict_yaml import read_yaml

MotionLayout = Literal["bodies_b", "joints_bodies_w"]

MOTION_ATTACHMENT = "motion.mcap"
"""Name of the motion file inside a recording."""

_TOPIC = "/motion"
_LIBRARY = "humanoid_sim"
_NANOSECONDS = 1e9
_SEVERAL = "; `play --motion-topic` takes one of several"


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
        if self.layout not in get_args(MotionLayout):
            accepted = ", ".join(get_args(MotionLayout))
            raise FieldError(f"Motion.layout: is {self.layout!r}, expected one of {accepted}")
        width, bodies, joints = frames.shape[1], len(self.body_names), len(self.joint_names)
        expected, parts = width, ""
        if self.layout == "joints_bodies_w":
            expected = 2 * joints + 7 * bodies
            parts = f"2 for each of {joints} joints and 7 for each of {bodies} bodies"
        elif bodies and self.task_type == "tracking":
            expected, parts = 9 * bodies, f"9 for each of {bodies} bodies"
        if width != expected:
            raise FieldError(f"Motion.frames: {width} values per frame, expected {expected}, that is {parts}")
        if not (np.isfinite(self.policy_dt) and self.policy_dt > 0.0):
            raise FieldError(f"Motion.policy_dt: is {self.policy_dt}, expected a positive number of seconds")
        frames.setflags(write=False)
        object.__setattr__(self, "frames", frames)
        object.__setattr__(self, "body_names", tuple(self.body_names))
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        object.__setattr__(self, "policy_dt", float(self.policy_dt))

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
    """Read and check a motion file, or a folder of rosbag2.

    Raises `InputError` with the file and what is wrong with it.

    Args:
        topic: of the motion, where there are others; None: it has to be the only one.
    """
    path = Path(path)
    with blaming(f"{path}: cannot be read", OSError):
        if (path / _METADATA).is_file():  # a folder that rosbag2 has written
            return _motion(path, _read_rows(path, bag_streams(path), topic))
        path = regular_file(path, "a motion file (.mcap) or a folder of rosbag2", None)
        with path.open("rb") as file:
            return _motion(path, _read_rows(path, [(path, McapStream(file))], topic))


def parse_motion(data: bytes, name: str) -> Motion:
    """Return a motion from the bytes of its file; `name` is what to call it in messages."""
    return _motion(Path(name), _read_rows(Path(name), [(Path(name), McapStream(BytesIO(data)))]))


_Rows = tuple[list[Float32Array], list[int], Mapping[str, str]]
"""Frames in file order, their log times in ns, and the metadata record `motion`."""


def _motion(path: Path, found: _Rows) -> Motion:
    rows, times, metadata = found
    layout = metadata.get("layout", "bodies_b")
    with blaming(path):
        return Motion(
            frames=np.stack(rows),
            body_names=names(metadata.get("body_names", "")),
            policy_dt=_policy_dt(metadata, times),
            task_type=metadata.get("task_type", ""),
            robot=metadata.get("robot", ""),
            layout=layout,  # type: ignore[arg-type]  # checked at construction
            joint_names=names(metadata.get("joint_names", "")),
        )


def _read_rows(
    path: Path,
    streams: Iterable[tuple[Path, McapStream]],
    topic: str | None = None,
    *,
    is_inner: bool = False,
) -> _Rows:
    metadata: dict[str, str] = {}
    rows: list[Float32Array] = []
    times: list[int] = []
    kinds: dict[str, str] = {}
    """Type of each topic."""
    for file, stream in streams:
        schemas: dict[int, str] = {}
        channels: dict[int, Channel] = {}
        for record in stream:
            if isinstance(record, Attachment) and record.name == MOTION_ATTACHMENT and topic is None:
                if is_inner:
                    raise InputError(f"{path}: its motion holds a motion of its own, expected one episode")
                attached = [one for one in stream if isinstance(one, Attachment) and one.name == MOTION_ATTACHMENT]
                last = [record, *attached][-1]  # of the policy that was loaded last
                return _read_rows(path, [(file, McapStream(BytesIO(last.data)))], is_inner=True)
            if isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                channels[record.id] = record
                kinds[record.topic] = schemas.get(record.schema_id, "no schema")
                _check_channel(path, record, kinds, topic)
            elif isinstance(record, Metadata) and record.name == "motion":
                metadata = record.metadata
            elif isinstance(record, Message) and _is_frame(path, record, channels, topic, rows):
                if times and record.log_time < times[-1]:
                    raise InputError(f"{path}: time goes back at frame {len(rows)}; a motion file holds one episode")
                rows.append(_row(path, record, rows))
                times.append(record.log_time)
        if stream.damage:
            raise InputError(f"{file}: {stream.damage}")
    if not rows:
        if topic is not None and topic not in kinds:
            raise InputError(f"{path}: {known_names('topic', topic, kinds)}")
        raise InputError(f"{path}: holds no frames, expected one topic of {FLOAT32_MULTI_ARRAY}")
    return rows, times, metadata


def _is_frame(
    path: Path, message: Message, channels: Mapping[int, Channel], topic: str | None, rows: Sequence[object]
) -> bool:
    """Return whether a message is on the motion's topic."""
    if message.channel_id not in channels:
        raise InputError(f"{path}: frame {len(rows)} is on a channel that the file does not define")
    return topic in (None, channels[message.channel_id].topic)


def _row(path: Path, record: Message, before: list[Float32Array]) -> Float32Array:
    """One frame, as wide as those before it."""
    frame = len(before)
    try:
        values = decode_float32_array(record.data)
    except CdrError as error:
        raise InputError(f"{path}: frame {frame} is not a {FLOAT32_MULTI_ARRAY}: {error}") from None
    if before and len(values) != len(before[0]):
        raise InputError(f"{path}: frame {frame} has {len(values)} values, the frames before {len(before[0])}")
    return values


def _check_channel(path: Path, channel: Channel, kinds: Mapping[str, str], topic: str | None) -> None:
    """Refuse a topic of another type, and one that is not the only one where none is named."""
    kind = kinds[channel.topic]
    if topic not in (None, channel.topic):
        return
    if kind != FLOAT32_MULTI_ARRAY or channel.message_encoding != "cdr":
        raise InputError(
            f"{path}: topic '{channel.topic}' is {kind} ({channel.message_encoding}), "
            f"expected one topic of {FLOAT32_MULTI_ARRAY} (cdr){_SEVERAL}"
        )
    for other in kinds if topic is None else ():
        if other != channel.topic:
            raise InputError(f"{path}: has the topics '{other}' and '{channel.topic}', expected exactly one{_SEVERAL}")


def _policy_dt(metadata: Mapping[str, str], times: list[int]) -> float:
    """Return the frame period in s: as the file says it, or, if it does not, as its evenly spaced log times show it."""
    text = metadata.get("policy_dt")
    if text is not None:
        try:
            return float(text)
        except ValueError:
            raise FieldError(f"policy_dt: is '{text}', expected a positive number of seconds") from None
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


_METADATA = "metadata.yaml"


def bag_streams(folder: Path) -> Iterator[tuple[Path, McapStream]]:
    """Yield each of a bag's MCAP files, in order, with its records."""
    place = folder / _METADATA
    document = read_yaml(place)
    information = document.get("rosbag2_bagfile_information") if isinstance(document, dict) else None
    if not isinstance(information, dict):
        raise InputError(f"{place}: has no rosbag2_bagfile_information, expected the metadata of a rosbag2 bag")
    storage, names = information.get("storage_identifier"), information.get("relative_file_paths")
    if storage != "mcap":
        raise InputError(f"{place}: storage_identifier: is {storage!r}, expected 'mcap'")
    if not (isinstance(names, list) and names and all(isinstance(name, str) for name in names)):
        raise InputError(f"{place}: relative_file_paths: is {names!r}, expected the names of the bag's files")
    for name in names:
        # Older versions of rosbag2 repeat the folder's name.
        file = regular_file(folder / Path(name).name, "a file of the bag", None)
        with file.open("rb") as opened:
            yield file, McapStream(opened)
