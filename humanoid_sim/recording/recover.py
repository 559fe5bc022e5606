"""Makes a whole file of a recording that was cut short or damaged: everything that is sound, and an index."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.records import Attachment, Channel, Header, Metadata, Schema

from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import is_file, output_file, regular_file, whole_file
from humanoid_sim.recording.recorder import TICK_TOPIC
from humanoid_sim.ros2.mcap_stream import McapStream, Message
from humanoid_sim.ros2.mcap_writer import ChunkedWriter


@dataclass(frozen=True, slots=True)
class Recovery:
    """Result of a recovery."""

    output: Path
    messages: int
    duration: float
    """s between the first and the last message."""
    was_complete: bool
    """Nothing was wrong with the input."""
    damage: str
    """Damage to the input, and where it is; empty if there is none."""
    dropped: int
    """Messages known to be lost: counted by the index behind a damaged chunk, or on a channel whose definition is."""
    places: int
    """Places at which the input is damaged."""
    missing_ticks: int | None
    """Ticks of a recording of this program that are known to be missing from the output; None for another file."""


def default_output(path: Path) -> Path:
    """`run.mcap` -> `run.recovered.mcap`, beside it."""
    return path.with_name(f"{path.stem}.recovered.mcap")


def recover(path: Path, output: Path, *, overwrite: bool = False) -> Recovery:
    """Copy what is sound in any MCAP file to `output`, with an index.

    Raises `InputError` if `path` is not an MCAP file or holds no sound message, or `output` exists (unless
    `overwrite`), is the input, or cannot be written.
    """
    regular_file(path, "a recording (.mcap)")
    if is_file(output) and output.samefile(path):
        raise InputError(f"{output}: is the file to recover, expected another name")
    output_file(output, "--output", overwrite=overwrite)
    with blaming(f"{path}: cannot be read", OSError), path.open("rb") as source:
        stream = McapStream(source, past_damage=True)
        with whole_file(output) as target:
            copied = _copy(path, stream, target)
    counted = sum(count for damage in stream.damages for count in damage.messages.values())
    lost_at_end = sum(
        damage.messages.get(channel, 0)
        for damage in stream.damages[copied.sound_to :]
        for channel in copied.tick_channels
    )
    return Recovery(
        output,
        copied.messages,
        (copied.last - copied.first) / 1e9,
        stream.is_complete,
        stream.damage,
        dropped=counted + copied.undefined,
        places=len(stream.damages),
        missing_ticks=copied.skipped_ticks + lost_at_end if copied.tick_channels else None,
    )


@dataclass(slots=True)
class _Copied:
    """Counts of what was copied, and of what was missing."""

    messages: int = 0
    undefined: int = 0
    """Messages on channels whose definition is lost."""
    first: int = 0
    last: int = 0
    """ns"""
    tick_channels: list[int] = field(default_factory=list)
    next_tick: int = 0
    skipped_ticks: int = 0
    sound_to: int = 0
    """Damaged places before the last tick."""

    def add(self, record: Message, is_defined: bool, damages: int) -> None:
        """Take note of a message, behind so many damaged places."""
        if not is_defined:
            self.undefined += 1
            return
        self.first = record.log_time if not self.messages else min(self.first, record.log_time)
        self.last = max(self.last, record.log_time)
        self.messages += 1
        if record.channel_id in self.tick_channels:
            self.skipped_ticks += max(record.sequence - self.next_tick, 0)
            self.next_tick, self.sound_to = record.sequence + 1, damages


def _copy(path: Path, stream: McapStream, target: IO[bytes]) -> _Copied:
    """Copy every record."""
    writer = ChunkedWriter(target)
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    copied = _Copied()
    for record in stream:
        if isinstance(record, Header):
            writer.start(record.profile, record.library)
        elif isinstance(record, Schema):
            if record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel):
            if record.id not in channels:
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
                )
                copied.tick_channels += [record.id] if record.topic == TICK_TOPIC else []
        elif isinstance(record, Message):
            channel = channels.get(record.channel_id)
            if channel is None and not stream.damages:
                raise InputError(f"{path}: a message on channel {record.channel_id}, which is not defined")
            if channel is not None:
                writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            copied.add(record, channel is not None, len(stream.damages))
        elif isinstance(record, Attachment):
            writer.flush()  # it stays behind the messages that come before it
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata):
            writer.flush()
            writer.add_metadata(record.name, record.metadata)
    if not copied.messages:
        raise InputError(f"{path}: nothing to recover: {stream.damage or 'it holds no messages'}")
    writer.finish()
    return copied
