"""Reads recordings, finished or cut short by a killed process: the header, then ticks and events in their order."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader

from humanoid_sim.errors import InputError, blaming, needing, reason_of
from humanoid_sim.files import regular_file
from humanoid_sim.messages import Event, SessionHeader, TickRecord
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.recording.codec import decode_event, decode_tick
from humanoid_sim.recording.header import DOCUMENTS, LABELS_DOCUMENT, SESSION, json_document, parse_header
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.topics import EVENT_TOPIC, TICK_TOPIC

_DECODERS: dict[str, Callable[[bytes], TickRecord | Event]] = {TICK_TOPIC: decode_tick, EVENT_TOPIC: decode_event}
_UNSOUND = McapError, RuntimeError, ValueError, OverflowError, MemoryError, struct.error  # mcap's, and what LZ4 raises
_IMU = {"imu_quaternion": "wxyz", "imu_angular_velocity": "xyz", "imu_linear_acceleration": "xyz"}


class Recording:
    """One recording. Reading streams the file, so a long one takes no more memory than a short one."""

    def __init__(self, path: Path) -> None:
        """Read the header. Raises `InputError` naming the file and what is wrong with it."""
        self.path = path
        self.is_complete = False
        """True if the file is sound and ends as a finished one does; known once it has been read to its end."""
        self.damage = ""
        """Damage to the file, and where it is; empty for a complete file. Known likewise."""
        self.header = self._read_header()

    def ticks(self) -> Iterator[TickRecord]:
        """Yield the ticks alone. Raises as `entries` does."""
        return (entry for entry in self.entries() if isinstance(entry, TickRecord))

    def entries(self) -> Iterator[TickRecord | Event]:
        """Yield ticks and events in file order, to the first chunk that is not whole.

        Raises `InputError` if a message is not what its topic says, which no cut explains.
        """
        topics: dict[int, str] = {}
        for record in self._records():
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and topics.get(record.channel_id, "") in _DECODERS:
                topic = topics[record.channel_id]
                with blaming(f"{self.path}: message {record.sequence} of {topic}", CdrError):
                    entry = _DECODERS[topic](record.data)
                joints = entry.input.state.joint_position.shape if isinstance(entry, TickRecord) else None
                if joints not in (None, (len(self.header.joint_names),)):
                    raise InputError(f"{self.path}: its ticks have joints of shape {joints}, its header others")
                yield entry

    def arrays(self) -> dict[str, Any]:
        """Return everything as arrays, a row per tick.

        `time`, shape (t,), s on the robot's clock; `mode`, (t,), numbers of `Mode`; `position`, `velocity`, `effort`
        and `command_position`, `command_velocity`, `command_effort`, `command_stiffness`, `command_damping`, (t, n), in
        the recording's order of joints, rad, rad/s, N·m, N·m/rad and N·m·s/rad; `imu_quaternion`, (t, 4), w x y z,
        `imu_angular_velocity` and `imu_linear_acceleration`, (t, 3), rad/s and m/s² in the IMU's frame; `action`,
        (t, m), NaN where no policy ran. Raises `InputError` as `ticks` does.
        """
        unknown = np.full(len(self._action_names()), np.nan)
        rows = []
        for tick in self.ticks():
            state, command, step = tick.input.state, tick.output.command, tick.output.policy_step
            row: dict[str, Any] = {"time": state.time, "mode": int(tick.output.control_mode.mode)}
            row |= {name: getattr(state, f"joint_{name}") for name in ("position", "velocity", "effort")}
            row |= {f"command_{name}": getattr(command, name) for name in COMMAND_FIELDS}
            row |= {name: getattr(state, name) for name in _IMU}
            row["action"] = unknown if step is None or step.action.shape != unknown.shape else step.action
            rows.append(row)
        if not rows:
            raise InputError(f"{self.path}: holds no ticks")
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def columns(self) -> dict[str, Any]:
        """Return `arrays` as columns of a table, (t,) each, with names such as `position/left_elbow_pitch`."""
        parts: dict[str, Any] = {"action": self._action_names(), **_IMU}
        columns: dict[str, Any] = {}
        for name, values in self.arrays().items():
            if values.ndim == 1:
                columns[name] = values
            else:
                names = parts.get(name, self.header.joint_names)
                columns |= {f"{name}/{part}": values[:, i] for i, part in enumerate(names)}
        return columns

    def frame(self) -> Any:
        """Return the table as a pandas frame. Raises `MissingPackageError` without pandas."""
        with needing("pandas", "report", "a frame"):
            import pandas as pd  # noqa: PLC0415 - an optional package
        return pd.DataFrame(self.columns())

    def _action_names(self) -> list[str]:
        return list(json_document(self.header, LABELS_DOCUMENT).get("action", ()))

    def _read_header(self) -> SessionHeader:
        documents: Mapping[str, str] = {}
        attachments: dict[str, bytes] = {}
        for record in self._records():
            if isinstance(record, Attachment):
                attachments[record.name] = record.data
            elif isinstance(record, Metadata) and record.name == DOCUMENTS:
                documents = record.metadata
            elif isinstance(record, Metadata) and record.name == SESSION:
                return parse_header(str(self.path), record.metadata, documents, attachments)
        reason = f"{self.damage}, before its header" if self.damage else f"it has no metadata record {SESSION!r}"
        raise InputError(f"{self.path}: no recording: {reason}")

    def _records(self) -> Iterator[McapRecord]:
        """Yield the file's records up to its end, or to the first that is not sound: see `damage`."""
        self.is_complete, self.damage = False, ""
        path = regular_file(self.path, "a recording (.mcap)", None)
        with path.open("rb") as file:
            size = path.stat().st_size
            try:
                yield from StreamReader(file, validate_crcs=True).records
                self.is_complete = True
            except _UNSOUND as error:
                is_cut = file.tell() >= size
                self.damage = f"cut at byte {size}" if is_cut else f"damaged at byte {file.tell()}: {reason_of(error)}"


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Open a recording and read its header. Raises `InputError` naming the file and what is wrong with it."""
    return Recording(Path(path))
