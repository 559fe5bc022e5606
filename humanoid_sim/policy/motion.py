"""Reference motions on disk: one episode as an MCAP file of `std_msgs/msg/Float32MultiArray`, one message per frame.

A tracking frame of the layout `bodies_b` is `[positions 3·B | orientations 6·B]` in the base frame, metres; an
orientation is the first two columns of its rotation matrix, flattened row by row. One of the layout `joints_bodies_w`
is `[joint positions n | joint velocities n | positions 3·B | quaternions w x y z 4·B]`, rad, rad/s and metres, world
frame. A piano frame is the goal state of the keys, 0 or 1. Files of other writers, without the metadata record
`motion`, are read too.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from mcap.reader import make_reader
from mcap.records import Message
from mcap.writer import CompressionType, Writer

from humanoid_sim.controllers.parameters import one_of, require
from humanoid_sim.controllers.rotation import rotation_6d, rotation_from_6d
from humanoid_sim.errors import FieldError, InputError, blaming, number_in
from humanoid_sim.files import regular_file
from humanoid_sim.mit import Float32Array, FloatArray
from humanoid_sim.policy.readers.own import csv
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.definitions import FLOAT32_MULTI_ARRAY, SCHEMA_ENCODING, schema_text
from humanoid_sim.ros2.messages import decode_float32_array, encode_float32_array

MotionLayout = Literal["bodies_b", "joints_bodies_w"]
MOTION_ATTACHMENT = "motion.mcap"  # name of the motion file inside a recording


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One episode of a reference motion, checked and read-only."""

    frames: Float32Array  # shape (F, width), one row per policy step, F ≥ 1; finite
    body_names: tuple[str, ...]  # the B tracked bodies in the order of the frame; empty if the file does not say
    policy_dt: float  # s between two frames
    task_type: str = "tracking"  # `tracking`, `piano` or `locomotion`; empty if the file does not say
    robot: str = ""  # that the motion was made for; empty if the file does not say
    layout: MotionLayout = "bodies_b"
    joint_names: tuple[str, ...] = ()  # the n joints of the layout `joints_bodies_w`, in the order of the frame

    def __post_init__(self) -> None:
        frames = np.array(self.frames, dtype=np.float32)
        require(frames.ndim == 2 and frames.size, "Motion.frames", f"of shape {frames.shape}", "(F, width), not empty")
        if not np.isfinite(frames).all():
            frame, index = np.argwhere(~np.isfinite(frames))[0].tolist()
            raise FieldError(f"Motion.frames: value {index} of frame {frame} is {frames[frame, index]}, not finite")
        one_of("Motion", "layout", self.layout, MotionLayout)
        width, bodies, joints = frames.shape[1], len(self.body_names), len(self.joint_names)
        if self.layout == "joints_bodies_w":
            expected = 2 * joints + 7 * bodies
        else:
            expected = 9 * bodies if bodies and self.task_type == "tracking" else width
        what = f"{expected}: layout {self.layout} of {joints} joints and {bodies} bodies"
        require(width == expected, "Motion.frames", f"{width} values per frame", what)
        require(0.0 < self.policy_dt < np.inf, "Motion.policy_dt", self.policy_dt, "seconds > 0")
        frames.setflags(write=False)
        object.__setattr__(self, "frames", frames)

    @property
    def duration(self) -> float:
        """Time from the first frame to the last, s."""
        return (len(self.frames) - 1) * self.policy_dt


def body_frames(position: FloatArray, rotation: FloatArray) -> FloatArray:
    """Frames (F, 9 B) of the layout `bodies_b`, from (F, B, 3), m, and (F, B, 3, 3), base frame."""
    count = len(position)
    return np.concatenate([position.reshape(count, -1), rotation_6d(rotation).reshape(count, -1)], axis=1)


def body_poses(frames: npt.NDArray[np.floating], count: int) -> tuple[FloatArray, FloatArray]:
    """Positions (F, B, 3), m, and rotation matrices (F, B, 3, 3), base frame, in frames (F, 9 B) of `count` bodies."""
    values = np.asarray(frames, dtype=np.float64)
    rotation = rotation_from_6d(values[:, 3 * count :].reshape(-1, count, 6))
    return values[:, : 3 * count].reshape(-1, count, 3), rotation


def read_motion(path: str | os.PathLike[str]) -> Motion:
    """Read a motion file, or the motion of a recording."""
    file = regular_file(path, "a motion file (.mcap)")
    if file.suffix in (".npz", ".csv"):
        how = f"python -m humanoid_sim.prepare --motion {file} makes one"
        raise InputError(f"{file}: is not a motion file (.mcap); {how}")
    return parse_motion(file.read_bytes(), str(path))


def parse_motion(data: bytes, name: str) -> Motion:
    """Return a motion from the bytes of its file; `name` is what to call it in messages."""
    messages: dict[str, list[Message]] = {}
    metadata: Mapping[str, str] = {}
    with blaming(f"{name}: is not a whole MCAP file", Exception):  # the library raises whatever it meets
        reader = make_reader(BytesIO(data))
        for attachment in reader.iter_attachments():
            if attachment.name == MOTION_ATTACHMENT:  # of a recording
                return parse_motion(attachment.data, name)
        for record in reader.iter_metadata():
            metadata = record.metadata if record.name == "motion" else metadata
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if schema is not None and schema.name == FLOAT32_MULTI_ARRAY:
                messages.setdefault(channel.topic, []).append(message)
    with blaming(name):
        if len(messages) != 1:
            listed = ", ".join(messages) or "none"
            raise FieldError(f"has the topics {listed} of {FLOAT32_MULTI_ARRAY}, expected one")
        return _episode(next(iter(messages.values())), metadata)


def _episode(messages: Sequence[Message], metadata: Mapping[str, str]) -> Motion:
    rows: list[Float32Array] = []
    for i, message in enumerate(messages):
        with blaming(f"frame {i} is not a {FLOAT32_MULTI_ARRAY}", CdrError, FieldError):
            rows.append(decode_float32_array(message.data))
        if len(rows[i]) != len(rows[0]):
            raise FieldError(f"frame {i} has {len(rows[i])} values, the frames before {len(rows[0])}")
    steps = np.diff([message.log_time for message in messages])
    if (steps < 0).any():
        raise FieldError(f"time goes back at frame {int(np.argmax(steps < 0)) + 1}; a motion file holds one episode")
    policy_dt = number_in(metadata.get("policy_dt", ""))
    if "policy_dt" not in metadata:
        if not len(steps) or steps.min() <= 0 or np.ptp(steps) > 0.01 * steps.mean():
            raise FieldError("policy_dt: not in the metadata record 'motion', and the frames are not evenly spaced")
        policy_dt = float(round(steps.mean())) / 1e9
    given: dict[str, Any] = {"layout": metadata.get("layout", "bodies_b")}
    given |= {name: metadata.get(name, "") for name in ("task_type", "robot")}
    given |= {name: tuple(csv(metadata.get(name, ""))) for name in ("body_names", "joint_names")}
    return Motion(np.stack(rows), policy_dt=policy_dt, **given)


def motion_bytes(motion: Motion) -> bytes:
    """Return a motion file's bytes; the same motion gives the same."""
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.LZ4)
    # The library's name without its version: the bytes must not change with an update of it.
    writer.start(profile="ros2", library="humanoid_sim")
    metadata = {
        **{"robot": motion.robot, "body_names": ",".join(motion.body_names)},
        **{"policy_dt": repr(motion.policy_dt), "task_type": motion.task_type},
    }
    if motion.layout != "bodies_b":
        metadata |= {"layout": motion.layout, "joint_names": ",".join(motion.joint_names)}
    writer.add_metadata("motion", metadata)
    schema = writer.register_schema(FLOAT32_MULTI_ARRAY, SCHEMA_ENCODING, schema_text(FLOAT32_MULTI_ARRAY).encode())
    channel = writer.register_channel("/motion", "cdr", schema)
    for index, frame in enumerate(motion.frames):
        time = round(index * motion.policy_dt * 1e9)  # ns
        writer.add_message(channel, time, encode_float32_array(frame), time, index)
    writer.finish()
    return stream.getvalue()
