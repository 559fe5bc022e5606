"""Reads an MCAP file record by record from its front, whole, damaged or cut short, and says where it is not sound.

The `mcap` package's own readers need the index at the end of the file, or trust every length they meet. A recording
whose process was killed has no index and ends anywhere, so this one checks each length against the file and each chunk
against its checksum. It ends at the first record that is not whole.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import IO, Any, NamedTuple, TypeAlias

import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_FOOTER_SIZE = 20


class Message(NamedTuple):
    """One message, its payload not yet decoded."""

    channel_id: int
    sequence: int
    log_time: int
    """ns"""
    publish_time: int
    """ns"""
    data: bytes


Record: TypeAlias = Header | Schema | Channel | Message | Attachment | Metadata


class _UnsoundError(Exception):
    """A record that cannot be trusted."""


class _CutError(_UnsoundError):
    """A record that is longer than the file."""


class McapStream:
    """Iterates once over the records of an MCAP file. Iterating never raises for what the file holds."""

    def __init__(self, file: IO[bytes]) -> None:
        """Prepare to read."""
        self._file = file
        self._size = file.seek(0, os.SEEK_END)
        self.is_mcap = False
        """The file starts as an MCAP file does; known once iteration has begun."""
        self.is_complete = False
        """Every record was sound, to the index of a finished file; known once iteration has ended."""
        self.is_damaged = False
        """A record is not sound, which no early end explains. Known likewise."""
        self.damage = ""
        """Description of what is not sound, and at which byte; empty for a complete file."""

    def __iter__(self) -> Iterator[Record]:
        self._file.seek(0)
        self.is_mcap = self._file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC
        if not self.is_mcap:
            self.damage = "not an MCAP file" if self._size else "the file is empty"
            return
        while True:
            start = self._file.tell()
            try:
                opcode, body = self._next_record(start)
                if opcode == Opcode.DATA_END:
                    self._skip_summary()
                    self.is_complete = True
                    return
                records = _records(opcode, body)
            except _UnsoundError as error:
                self.damage = f"{error} at byte {start} of {self._size}"
                self.is_damaged = not isinstance(error, _CutError)
                return
            yield from records

    def _next_record(self, start: int) -> tuple[int, bytes]:
        head = self._file.read(_RECORD.size)
        if len(head) < _RECORD.size:
            raise _CutError("cut")
        opcode, length = _RECORD.unpack(head)
        if opcode == 0:
            raise _UnsoundError("damaged (no record)")  # a file system's zeros after a power cut
        if length > self._size - start - _RECORD.size:
            raise _CutError("cut")
        return opcode, self._file.read(length)

    def _skip_summary(self) -> None:
        """Step over the summary section to the footer and the closing magic."""
        while True:
            start = self._file.tell()
            opcode, body = self._next_record(start)
            if opcode == Opcode.FOOTER:
                if len(body) != _FOOTER_SIZE or self._file.read(len(MCAP0_MAGIC) + 1) != MCAP0_MAGIC:
                    raise _CutError("cut in the index")
                return


def _records(opcode: int, body: bytes) -> list[Record]:
    """Return the records of one top-level record: itself, or a chunk's content."""
    try:
        if opcode == Opcode.CHUNK:
            return _chunk_records(body)
        record = _parse(opcode, body)
        return [] if record is None else [record]
    except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
        raise _UnsoundError(f"damaged ({error or type(error).__name__})") from error


_PARSERS: dict[int, Callable[[ReadDataStream], Any]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
    Opcode.ATTACHMENT: Attachment.read,
}


def _parse(opcode: int, body: bytes) -> Record | None:
    """One record that is not a chunk; None for a kind that does not matter here."""
    if opcode == Opcode.MESSAGE:
        channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(body)
        return Message(channel_id, sequence, log_time, publish_time, body[_MESSAGE.size :])
    if opcode == Opcode.ATTACHMENT:
        (checksum,) = struct.unpack_from("<I", body, len(body) - 4)
        if checksum and zlib.crc32(body[:-4]) != checksum:
            raise _UnsoundError("damaged (checksum of an attachment)")
    parse = _PARSERS.get(opcode)
    if parse is None:
        return None
    record: Record = parse(ReadDataStream(BytesIO(body)))
    return record


def _chunk_records(body: bytes) -> list[Record]:
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    data = _decompress(chunk)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise _UnsoundError("damaged (checksum of a chunk)")
    records: list[Record] = []
    position, size = 0, len(data)
    while position < size:
        opcode, length = _RECORD.unpack_from(data, position)
        position += _RECORD.size
        if length > size - position:
            raise _UnsoundError("damaged (a record longer than its chunk)")
        record = _parse(opcode, data[position : position + length])
        if record is not None:
            records.append(record)
        position += length
    return records


def _decompress(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "lz4":
        try:
            # The decompressor object stops at `size`; the plain function allocates whatever the data asks for.
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size)
        except RuntimeError as error:
            raise _UnsoundError(f"damaged ({error})") from error
    elif chunk.compression == "zstd":
        import zstandard  # noqa: PLC0415  (only files of other writers need it)

        try:
            # The size in the frame's own header would be believed before `size` is.
            claimed = zstandard.frame_content_size(chunk.data)
            if claimed > size:
                raise _UnsoundError(f"damaged (a chunk of {claimed} bytes instead of {size})")
            data = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
        except zstandard.ZstdError as error:
            raise _UnsoundError(f"damaged ({error})") from error
    else:
        raise _UnsoundError(f"unknown compression '{chunk.compression}'")
    if len(data) != size:
        raise _UnsoundError(f"damaged (a chunk of {len(data)} bytes instead of {size})")
    return data
