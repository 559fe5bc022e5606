"""Makes a whole file of a recording that was cut short: everything up to the last sound chunk, and an index."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.records import Attachment, Channel, Header, Metadata, Schema
from mcap.writer import CompressionType, Writer

from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file, regular_file, whole_file
from humanoid_sim.ros2.mcap_stream import McapStream, Message

__all__ = ["Recovery", "default_output", "recover"]


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was saved."""

    output: Path
    messages: int
    duration: float
    """s between the first and the last message."""
    was_complete: bool
    """Nothing was wrong with the input."""
    damage: str
    """Where and why the input ended early; empty if it did not."""


def default_output(path: Path) -> Path:
    """`run.mcap` -> `run.recovered.mcap`, beside it."""
    return path.with_name(f"{path.stem}.recovered.mcap")


def recover(path: Path, output: Path, *, force: bool = False) -> Recovery:
    """Copy what is sound in any MCAP file to `output`, with an index.

    Raises:
        InputError: if `path` is no MCAP file or holds no whole message, or `output` exists (unless `force`), is the
            input, or cannot be written.
    """
    regular_file(path, "a recording (.mcap)")
    if is_file(output) and output.samefile(path):
        raise InputError(f"{output}: is the file to recover, expected another name")
    if is_file(output) and not force:
        raise InputError(f"{output}: exists already, expected a new name or --force")
    try:
        with path.open("rb") as source:
            stream = McapStream(source)
            with whole_file(output) as target:
                messages, duration = _copy(path, stream, target)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    return Recovery(output, messages, duration, stream.is_complete, stream.damage)


def _copy(path: Path, stream: McapStream, target: IO[bytes]) -> tuple[int, float]:
    """Copy every record; returns the number of messages and the time they span in s."""
    writer = Writer(target, compression=CompressionType.LZ4)
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    messages, first, last = 0, 0, 0
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
        elif isinstance(record, Message):
            if record.channel_id not in channels:
                raise InputError(f"{path}: a message on channel {record.channel_id}, which is not defined")
            writer.add_message(
                channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence
            )
            first = record.log_time if not messages else min(first, record.log_time)
            last = max(last, record.log_time)
            messages += 1
        elif isinstance(record, Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
    if not messages:
        raise InputError(f"{path}: nothing to recover: {stream.damage or 'it holds no messages'}")
    writer.finish()
    return messages, (last - first) / 1e9
