"""Reads recordings, finished or cut short by a killed process: the header, then ticks and events in their order."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeAlias

from mcap.records import Attachment, Channel, Metadata, Schema

from humanoid_sim.errors import InputError
from humanoid_sim.files import regular_file
from humanoid_sim.messages import Event, SessionHeader, TickRecord
from humanoid_sim.recording.codec import decode_event, decode_tick
from humanoid_sim.recording.earlier import (
    decode_earlier_event,
    decode_earlier_tick,
    has_event_kind,
    has_policy_error,
)
from humanoid_sim.recording.header import DOCUMENTS, SESSION, HeaderError, parse_header
from humanoid_sim.recording.recorder import EVENT_TOPIC, TICK_TOPIC
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.mcap_stream import McapStream, Message

__all__ = ["Entry", "Recording", "TopicCount", "open_recording"]


Entry: TypeAlias = TickRecord | Event
_Decoder: TypeAlias = Callable[[bytes], Entry]


@dataclass(slots=True)
class TopicCount:
    """How much a topic holds."""

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
        """The file ends as a finished one does; known once it has been read to its end."""
        self.damage = ""
        """Where and why reading ended early; empty for a finished file. Known once it has been read to its end."""
        self.topics: dict[str, TopicCount] = {}
        """What the file holds by topic; known once it has been read to its end."""

    def entries(self) -> Iterator[Entry]:
        """Ticks and events in file order, to the last chunk that is whole.

        Raises:
            InputError: if a message is not what its topic says, which no cut explains.
        """
        topics: dict[str, TopicCount] = {}
        with _open(self.path) as file:
            stream = McapStream(file)
            schemas: dict[int, Schema] = {}
            channels: dict[int, tuple[str, _Decoder | None]] = {}
            for record in stream:
                self.position = file.tell()
                if isinstance(record, Message):
                    if record.channel_id not in channels:
                        raise InputError(f"{self.path}: a message on channel {record.channel_id}, which is not defined")
                    topic, decode = channels[record.channel_id]
                    topics[topic].messages += 1
                    if decode is not None:
                        yield self._decoded(topic, decode, record)
                elif isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    schema = schemas.get(record.schema_id)
                    name, definition = ("", b"") if schema is None else (schema.name, schema.data)
                    channels[record.id] = (record.topic, _decoder(record.topic, definition))
                    topics.setdefault(record.topic, TopicCount(name))
            self.is_complete, self.damage = stream.is_complete, stream.damage
        self.topics = topics

    def ticks(self) -> Iterator[TickRecord]:
        """The ticks alone. Raises as `entries` does."""
        return (entry for entry in self.entries() if isinstance(entry, TickRecord))

    def _decoded(self, topic: str, decode: _Decoder, message: Message) -> Entry:
        try:
            return decode(message.data)
        except CdrError as error:
            raise InputError(f"{self.path}: message {message.sequence} of {topic}: {error}") from None


def _decoder(topic: str, definition: bytes) -> _Decoder | None:
    """What reads the messages of a topic, whose type the file defines so; None for topics that only viewers need."""
    if topic == TICK_TOPIC:
        return decode_tick if has_policy_error(definition) else decode_earlier_tick
    if topic == EVENT_TOPIC:
        return decode_event if has_event_kind(definition) else decode_earlier_event
    return None


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Open a recording and read its header.

    Raises:
        InputError: one line with the file and what is wrong with it.
    """
    path = Path(path)
    documents: dict[str, str] = {}
    attachments: dict[str, bytes] = {}
    with _open(path) as file:
        stream = McapStream(file)
        for record in stream:
            if isinstance(record, Attachment):
                attachments[record.name] = record.data
            elif isinstance(record, Metadata) and record.name == DOCUMENTS:
                documents = record.metadata
            elif isinstance(record, Metadata) and record.name == SESSION:
                try:
                    return Recording(path, parse_header(record.metadata, documents, attachments))
                except HeaderError as error:
                    raise InputError(f"{path}: {error}") from None
            elif isinstance(record, Message):
                break
    reason = stream.damage or f"an MCAP file, but no recording of this program: it has no metadata record '{SESSION}'"
    raise InputError(f"{path}: {reason}")


def _open(path: Path) -> IO[bytes]:
    try:
        return regular_file(path, "a recording (.mcap)").open("rb")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
