"""Writes MCAP files as `mcap.writer.Writer` does with LZ4, byte for byte, at a quarter of its cost for a message.

A recorder shares the interpreter with a control loop, so what a message costs it costs the loop. The records that are
rare are the library's.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

import lz4.frame  # type: ignore[import-untyped]
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

_MESSAGE = struct.Struct("<BQHIQQ")
"""Opcode and length of the record; channel, sequence, log time, publish time; the data follow."""
_MESSAGE_FIELDS = _MESSAGE.size - 9
_INDEX = struct.Struct("<BQHI")
"""Opcode and length of the record; channel, bytes of the entries; pairs of time and offset follow."""
_CHUNK_SIZE = 1024 * 1024
"""Bytes; a chunk that is larger is ended."""


class Output(Protocol):
    """A file."""

    def write(self, data: bytes, /) -> object:
        """Append."""

    def tell(self) -> int:
        """Bytes so far."""

    def flush(self) -> None:
        """Hand everything on."""


class ChunkedWriter:
    """One file; its methods are those of the library's writer."""

    def __init__(self, file: Output) -> None:
        self._file = file
        self._parts: list[bytes] = []
        """Records of the chunk."""
        self._size = 0
        self._indices: dict[int, list[int]] = {}
        """By channel, the log time of each message and its place in the chunk, in turn."""
        self._start = self._end = 0
        """ns, log times of the chunk."""
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._attachments: list[records.AttachmentIndex] = []
        self._metadata: list[records.MetadataIndex] = []
        self._chunks: list[bytes] = []
        """`ChunkIndex` of each, encoded, for objects need five times the memory: a recording has three a second."""
        self._times: tuple[int, int] | None = None  # ns, the first and the last of all chunks
        self._counts: dict[int, int] = {}

    def start(self, profile: str, library: str) -> None:
        """Begin the file."""
        self._file.write(MCAP0_MAGIC + _encoded(records.Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Define a schema; its number."""
        schema = records.Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._add(_encoded(schema))
        return len(self._schemas)

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Define a channel; its number."""
        channel = records.Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=message_encoding,
            metadata=dict(metadata or {}),
            schema_id=schema_id,
        )
        self._channels.append(channel)
        self._add(_encoded(channel))
        return len(self._channels)

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Add a message; times in ns."""
        length = len(data)
        head = _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE_FIELDS + length, channel_id, sequence, log_time, publish_time)
        index = self._indices.get(channel_id)
        if not self._indices:
            self._start = self._end = log_time
        elif log_time > self._end:
            self._end = log_time
        elif log_time < self._start:
            self._start = log_time
        if index is None:
            index = self._indices[channel_id] = []
        index += (log_time, self._size)
        self._parts += (head, data)
        self._size += len(head) + length
        if self._size > _CHUNK_SIZE:
            self._end_chunk()

    def add_attachment(self, create_time: int, log_time: int, name: str, media_type: str, data: bytes) -> None:
        """Add a file."""
        attachment = records.Attachment(
            create_time=create_time, log_time=log_time, name=name, media_type=media_type, data=data
        )
        offset, encoded = self._file.tell(), _encoded(attachment)
        self._attachments.append(
            records.AttachmentIndex(
                offset=offset,
                length=len(encoded),
                log_time=log_time,
                create_time=create_time,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )
        self._file.write(encoded)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Add texts by name."""
        offset, encoded = self._file.tell(), _encoded(records.Metadata(name=name, metadata=data))
        self._metadata.append(records.MetadataIndex(offset, len(encoded), name))
        self._file.write(encoded)

    def flush(self) -> None:
        """End the chunk, if it holds a message, and hand everything to the file."""
        self._end_chunk()
        self._file.flush()

    def finish(self) -> None:
        """Write the index. The file stays open."""
        self._end_chunk()
        self._file.write(_encoded(records.DataEnd(0)))
        begin = self._file.tell()
        groups: list[tuple[Opcode, Iterable[bytes]]] = [
            (Opcode.SCHEMA, map(_encoded, self._schemas)),
            (Opcode.CHANNEL, map(_encoded, self._channels)),
            (Opcode.STATISTICS, [_encoded(self._statistics())]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, map(_encoded, self._attachments)),
            (Opcode.METADATA_INDEX, map(_encoded, self._metadata)),
        ]
        summary, offsets = b"", b""
        for opcode, encoded in groups:
            group = b"".join(encoded)
            offsets += _encoded(records.SummaryOffset(opcode, begin + len(summary), len(group)))
            summary += group
        offset_begin = begin + len(summary)
        summary += offsets
        crc = zlib.crc32(summary)
        crc = zlib.crc32(struct.pack("<BQQQ", Opcode.FOOTER, 8 + 8 + 4, begin, offset_begin), crc)
        self._file.write(summary + _encoded(records.Footer(begin, offset_begin, crc)) + MCAP0_MAGIC)

    def _add(self, record: bytes) -> None:
        """Add a definition: it goes into the chunk of the first message that needs it."""
        self._parts.append(record)
        self._size += len(record)
        if self._size > _CHUNK_SIZE:
            self._end_chunk()

    def _end_chunk(self) -> None:
        if not self._indices:
            return
        data = b"".join(self._parts)
        packed: bytes = lz4.frame.compress(data)
        offset = self._file.tell()
        chunk = _encoded(
            records.Chunk(
                compression="lz4",
                data=packed,
                message_end_time=self._end,
                message_start_time=self._start,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        self._file.write(chunk)
        at = offset + len(chunk)
        places, indices = {}, b""
        for channel, entries in self._indices.items():
            places[channel] = at + len(indices)
            size = 8 * len(entries)
            head = _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size)
            indices += head + struct.pack(f"<{len(entries)}Q", *entries)
            self._counts[channel] = self._counts.get(channel, 0) + len(entries) // 2
        self._file.write(indices)
        index = records.ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=offset,
            compression="lz4",
            compressed_size=len(packed),
            message_end_time=self._end,
            message_index_length=len(indices),
            message_index_offsets=places,
            message_start_time=self._start,
            uncompressed_size=len(data),
        )
        self._chunks.append(_encoded(index))
        first, last = self._times or (self._start, self._end)
        self._times = min(first, self._start), max(last, self._end)
        self._parts, self._size, self._indices = [], 0, {}

    def _statistics(self) -> records.Statistics:
        first, last = self._times or (0, 0)
        return records.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=last,
            message_start_time=first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def _encoded(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    write: Callable[[RecordBuilder], Any] = record.write
    write(builder)
    return bytes(builder.end())
