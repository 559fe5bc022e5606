"""Reads recordings, finished or cut short by a killed process: the header, then ticks and events in their order.

The ticks are also to be had as columns: arrays, a table for CSV files and pandas, and a figure.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np
from mcap.records import Attachment, Channel, Metadata, Schema

from humanoid_sim.errors import InputError, blaming, needing, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.messages import Event, Mode, SessionHeader, TickRecord
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray
from humanoid_sim.recording.codec import decode_event, decode_tick
from humanoid_sim.recording.header import DOCUMENTS, SESSION, HeaderError, parse_header
from humanoid_sim.recording.recorder import EVENT_TOPIC, TICK_TOPIC
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.mcap_stream import McapStream, Message

Entry: TypeAlias = TickRecord | Event
_Decoder: TypeAlias = Callable[[bytes], Entry]

_MEASURED = ("position", "velocity", "effort")
_IMU = ("imu_quaternion", "imu_angular_velocity", "imu_linear_acceleration")
_SHOWN = 7
"""Joints of a figure, where none are named."""
_COLOURS = {Mode.DAMPING: "gold", Mode.STANDBY: "skyblue", Mode.LOCOMOTION: "lightgreen", Mode.REMOTE: "plum"}


@dataclass(slots=True)
class TopicCount:
    """Schema of a topic, and the number of its messages."""

    schema: str
    messages: int = 0


class Recording:
    """One recording. Reading streams the file, so a long one takes no more memory than a short one."""

    def __init__(self, path: Path, header: SessionHeader) -> None:
        """Made by `open_recording`."""
        self.path = path
        self.header = header
        self.size = path.stat().st_size
        """Bytes."""
        self.position = 0
        """Bytes read so far by the reading in progress."""
        self.is_complete = False
        """The file is sound and ends as a finished one does; known once it has been read to its end."""
        self.damage = ""
        """Damage to the file, and where it is; empty for a complete file. Known once it has been read to its end."""
        self.is_damaged = False
        """Something in the file cannot be read, other than an end that is missing. Known likewise."""
        self.topics: dict[str, TopicCount] = {}
        """Contents of the file by topic; known once it has been read to its end."""

    def entries(self) -> Iterator[Entry]:
        """Ticks and events in file order, to the first chunk that is not whole.

        Raises `InputError` if a message is not what its topic says, which no cut explains.
        """
        topics: dict[str, TopicCount] = {}
        with _open(self.path) as file:
            stream = McapStream(file)
            schemas: dict[int, str] = {}
            channels: dict[int, str] = {}
            for record in stream:
                self.position = file.tell()
                if isinstance(record, Message):
                    topic = channels.get(record.channel_id, "")
                    if topic not in topics:
                        raise InputError(f"{self.path}: a message on channel {record.channel_id}, which is not defined")
                    topics[topic].messages += 1
                    if topic in _DECODERS:
                        yield self._decode(topic, record)
                elif isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    channels[record.id] = record.topic
                    topics.setdefault(record.topic, TopicCount(schemas.get(record.schema_id, "")))
            self.is_complete, self.damage, self.is_damaged = stream.is_complete, stream.damage, stream.is_damaged
        self.topics = topics

    def ticks(self) -> Iterator[TickRecord]:
        """Yield the ticks alone. Raises as `entries` does."""
        return (entry for entry in self.entries() if isinstance(entry, TickRecord))

    def action_names(self) -> tuple[str, ...]:
        """Return the joints that the recorded policy drives; none without a policy."""
        from humanoid_sim.stack import recorded_contract  # noqa: PLC0415 - heavier than all the rest here

        contract = recorded_contract(self.header)
        return () if contract is None else contract.action_joint_names

    def column_names(self) -> list[str]:
        """Return the names of the table's columns, such as `position/left_elbow_pitch`."""
        joints = self.header.joint_names
        quantities = (*_MEASURED, *(f"command_{name}" for name in COMMAND_FIELDS))
        return [
            *("time_s", "mode", "controller"),
            *(f"{quantity}/{joint}" for quantity in quantities for joint in joints),
            *(f"{name}/{part}" for name in _IMU for part in ("wxyz" if name == _IMU[0] else "xyz")),
            *("policy_frame", *(f"action/{name}" for name in self.action_names())),
        ]

    def rows(self) -> Iterator[list[object]]:
        """Yield a row per tick; what a tick does not have is empty text. Raises `InputError` as `ticks` does."""
        actions = len(self.action_names())
        for tick in self.ticks():
            control, step = tick.output.control_mode, tick.output.policy_step
            values = [value for array in _arrays_of(tick) for value in array.tolist()]
            answer = [] if step is None else step.action.reshape(-1).tolist()[:actions]
            frame = "" if step is None else step.frame
            blanks = [""] * (actions - len(answer))
            yield [
                float(tick.input.state.time),
                control.mode.name,
                control.controller_name,
                *values,
                frame,
                *answer,
                *blanks,
            ]

    def arrays(self) -> dict[str, Any]:
        """Return everything as arrays, a row per tick.

        `time`, shape (t,), s on the robot's clock; `mode`, (t,), numbers of `Mode`; `position`, `velocity`, `effort`
        and `command_position`, `command_velocity`, `command_effort`, `command_stiffness`, `command_damping`, (t, n), in
        the recording's order of joints, rad, rad/s, N·m, N·m/rad and N·m·s/rad; `imu_quaternion`, (t, 4), w x y z,
        `imu_angular_velocity` and `imu_linear_acceleration`, (t, 3), rad/s and m/s² in the IMU's frame; `action`,
        (t, m), NaN where no policy ran. Raises `InputError` as `ticks` does.
        """
        joints = len(self.header.joint_names)
        widths = dict.fromkeys((*_MEASURED, *(f"command_{name}" for name in COMMAND_FIELDS)), joints)
        widths |= dict(zip(_IMU, (4, 3, 3), strict=True))
        none = np.full(len(self.action_names()), np.nan)
        times, modes, actions, found = [], [], [], []
        for tick in self.ticks():
            step = tick.output.policy_step
            times.append(float(tick.input.state.time))
            modes.append(int(tick.output.control_mode.mode))
            actions.append(none if step is None else np.concatenate([step.action.reshape(-1), none])[: len(none)])
            found.append(_arrays_of(tick))
        columns = (np.array([arrays[i] for arrays in found]) for i in range(len(widths)))
        stacked = {name: column.reshape(-1, widths[name]) for name, column in zip(widths, columns, strict=True)}
        numbers = {"time": np.array(times), "mode": np.array(modes, dtype=np.int64)}
        return {**numbers, **stacked, "action": np.array(actions).reshape(-1, max(len(none), 1))[:, : len(none)]}

    def frame(self) -> Any:
        """Return the table as a pandas frame. Raises `MissingPackageError` without pandas."""
        with needing("pandas", "report", "a frame"):
            import pandas as pd  # noqa: PLC0415 - an optional package
        return pd.DataFrame(self.rows(), columns=self.column_names()).replace("", np.nan)

    def figure(self, *joints: str) -> Any:
        """Draw joints' positions and commands over time, the modes as background; the first few where none are named.

        Where a command has no stiffness, its position means nothing and is left out. Raises `InputError` if a joint is
        not one of the recording's, and `MissingPackageError` if Matplotlib is not installed, of which the figure is.
        """
        with needing("matplotlib", "report", "a figure"):
            from matplotlib.figure import Figure  # noqa: PLC0415 - an optional package
        names = self.header.joint_names
        require_known("joint", joints, names, "joints: ")
        shown, columns = joints or names[:_SHOWN], self.arrays()
        commands = np.where(columns["command_stiffness"] > 0.0, columns["command_position"], np.nan)

        class Shown(Figure):
            """Is drawn in a notebook, whatever else it has imported."""

            def _repr_png_(self) -> bytes:
                picture = io.BytesIO()
                self.savefig(picture, format="png")
                return picture.getvalue()

        drawn = Shown(figsize=(9.0, 1.3 * len(shown) + 0.9), layout="constrained")
        axes = drawn.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axis, joint in zip(axes, shown, strict=True):
            column = names.index(joint)
            _colour_modes(axis, columns["time"], columns["mode"])
            axis.plot(columns["time"], commands[:, column], color="tab:orange", label="command")
            axis.plot(columns["time"], columns["position"][:, column], color="tab:blue", label="position")
            axis.set_ylabel(f"{joint}\nrad", rotation=0, ha="right", va="center", fontsize="small")
        labelled = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
        drawn.legend(labelled.values(), labelled, loc="outside upper center", ncols=len(labelled), fontsize="small")
        axes[-1].set_xlabel("s")
        return drawn

    def _decode(self, topic: str, message: Message) -> Entry:
        try:
            return _DECODERS[topic](message.data)
        except CdrError as error:
            raise InputError(f"{self.path}: message {message.sequence} of {topic}: {error}") from None


def _colour_modes(axis: Any, time: FloatArray, mode: FloatArray) -> None:
    ends = [*np.flatnonzero(np.diff(mode)), len(mode) - 1] if len(mode) else []
    begin = 0
    for end in ends:
        shown = Mode(int(mode[end]))
        if shown in _COLOURS:
            axis.axvspan(time[begin], time[end], color=_COLOURS[shown], alpha=0.25, linewidth=0.0, label=shown.name)
        begin = end + 1


def _arrays_of(tick: TickRecord) -> list[FloatArray]:
    state, command = tick.input.state, tick.output.command
    measured = (state.joint_position, state.joint_velocity, state.joint_effort)
    imu = (state.imu_quaternion, state.imu_angular_velocity, state.imu_linear_acceleration)
    return [*measured, *(getattr(command, name) for name in COMMAND_FIELDS), *imu]


_DECODERS: dict[str, _Decoder] = {TICK_TOPIC: decode_tick, EVENT_TOPIC: decode_event}


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Open a recording and read its header. Raises `InputError` naming the file and what is wrong with it."""
    path = Path(path)
    documents: Mapping[str, str] = {}
    attachments: dict[str, bytes] = {}
    with _open(path) as file:
        stream = McapStream(file)
        for record in stream:
            if isinstance(record, Attachment):
                attachments[record.name] = record.data
            elif isinstance(record, Metadata) and record.name == DOCUMENTS:
                documents = record.metadata
            elif isinstance(record, Metadata) and record.name == SESSION:
                with blaming(path, HeaderError):
                    return Recording(path, parse_header(record.metadata, documents, attachments))
            elif isinstance(record, Message):
                break
    reason = stream.damage or f"an MCAP file, but no recording of this program: it has no metadata record '{SESSION}'"
    raise InputError(f"{path}: {reason}")


def _open(path: Path) -> IO[bytes]:
    with blaming(f"{path}: cannot be read", OSError):
        return regular_file(path, "a recording (.mcap)", None).open("rb")


def recorded_settings(path: str | Path, header: SessionHeader) -> dict[str, Any]:
    """Return the settings of a run; empty if its header says nothing.

    Raises `InputError`, which names the path, if what it says is not a JSON object.
    """
    with blaming(f"{path}: its header's 'settings' are no JSON", ValueError):
        settings = json.loads(header.documents.get("settings", "{}"))
    if not isinstance(settings, dict):
        raise InputError(f"{path}: its header's 'settings' are a {type(settings).__name__}, expected a JSON object")
    return settings
