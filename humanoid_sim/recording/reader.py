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
from humanoid_sim.recording.earlier import decode_earlier_event, decode_earlier_tick
from humanoid_sim.recording.header import DOCUMENTS, EARLIER_FORMAT, SESSION, HeaderError, parse_header
from humanoid_sim.recording.recorder import EVENT_TOPIC, TICK_TOPIC
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.mcap_stream import McapStream, Message

__all__ = ["Entry", "Recording", "TopicCount", "messages_of", "open_recording"]


Entry: TypeAlias = TickRecord | Event
_Decoder: TypeAlias = Callable[[bytes], Entry]


@dataclass(slots=True)
class TopicCount:
    """How much a topic holds."""

    schema: str
    messages: int = 0


class Recording:
    """One recording. Reading streams the file, so a long one takes no more memory than a short one."""

    def __init__(self, path: Path, header: SessionHeader, *, is_earlier: bool = False) -> None:
        """Made by `open_recording`; `is_earlier` for one of the earlier format."""
        self._decoders = _EARLIER_DECODERS if is_earlier else _DECODERS
        self.path = path
        self.header = header
        self.size = path.stat().st_size
        """Bytes."""
        self.position = 0
        """Bytes read so far by the reading in progress."""
        self.is_complete = False
        """The file is sound and ends as a finished one does; known once it has been read to its end."""
        self.damage = ""
        """What is wrong, and where; empty for a complete file. Known once it has been read to its end."""
        self.is_damaged = False
        """Something in the file cannot be read, other than an end that is missing. Known likewise."""
        self.lost_at_end = 0
        """Ticks that are known to be lost behind the last one that can be read. Known likewise."""
        self.topics: dict[str, TopicCount] = {}
        """What the file holds by topic; known once it has been read to its end."""

    def entries(self, *, past_damage: bool = False) -> Iterator[Entry]:
        """Ticks and events in file order, to the first chunk that is not whole.

        Args:
            past_damage: go on behind it; the ticks' indices then show what is missing.

        Raises:
            InputError: if a message is not what its topic says, which no cut explains.
        """
        topics: dict[str, TopicCount] = {}
        sound_to = 0
        with _open(self.path) as file:
            stream = McapStream(file, past_damage=past_damage)
            schemas: dict[int, str] = {}
            channels: dict[int, str] = {}
            for record in stream:
                self.position = file.tell()
                if isinstance(record, Message):
                    topic = channels.get(record.channel_id, "")
                    if topic not in topics and stream.damages:
                        continue  # defined in a chunk that is lost
                    if topic not in topics:
                        raise InputError(f"{self.path}: a message on channel {record.channel_id}, which is not defined")
                    topics[topic].messages += 1
                    sound_to = len(stream.damages) if topic == TICK_TOPIC else sound_to
                    if topic in self._decoders:
                        yield self._decode(topic, record)
                elif isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    channels[record.id] = record.topic
                    topics.setdefault(record.topic, TopicCount(schemas.get(record.schema_id, "")))
            self.is_complete, self.damage, self.is_damaged = stream.is_complete, stream.damage, bool(stream.damages)
            ticks = [channel for channel, topic in channels.items() if topic == TICK_TOPIC]
            self.lost_at_end = sum(damage.messages.get(i, 0) for damage in stream.damages[sound_to:] for i in ticks)
        self.topics = topics

    def ticks(self) -> Iterator[TickRecord]:
        """The ticks alone. Raises as `entries` does."""
        return (entry for entry in self.entries() if isinstance(entry, TickRecord))

    def _decode(self, topic: str, message: Message) -> Entry:
        try:
            return self._decoders[topic](message.data)
        except CdrError as error:
            raise InputError(f"{self.path}: message {message.sequence} of {topic}: {error}") from None


_DECODERS: dict[str, _Decoder] = {TICK_TOPIC: decode_tick, EVENT_TOPIC: decode_event}
_EARLIER_DECODERS: dict[str, _Decoder] = {TICK_TOPIC: decode_earlier_tick, EVENT_TOPIC: decode_earlier_event}


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
                    header = parse_header(record.metadata, documents, attachments)
                except HeaderError as error:
                    raise InputError(f"{path}: {error}") from None
                return Recording(path, header, is_earlier=record.metadata["format"] == EARLIER_FORMAT)
            elif isinstance(record, Message):
                break
    reason = stream.damage or f"an MCAP file, but no recording of this program: it has no metadata record '{SESSION}'"
    raise InputError(f"{path}: {reason}")


def messages_of(path: str | os.PathLike[str], topic: str) -> Iterator[bytes]:
    """The encoded messages of one topic in file order, to the first chunk that is not whole; none of another's.

    Raises:
        InputError: the file cannot be read.
    """
    channels: set[int] = set()
    with _open(Path(path)) as file:
        for record in McapStream(file):
            if isinstance(record, Channel) and record.topic == topic:
                channels.add(record.id)
            elif isinstance(record, Message) and record.channel_id in channels:
                yield record.data


def _open(path: Path) -> IO[bytes]:
    try:
        return regular_file(path, "a recording (.mcap)").open("rb")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
