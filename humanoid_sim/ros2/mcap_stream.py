"""Reads an MCAP file record by record from its front, whole, damaged or cut short, and says where it is not sound.

The `mcap` package's own readers need the index at the end of the file, or trust every length they meet. A recording
whose process was killed has no index and ends anywhere, so this one checks each length against the file and each chunk
against its checksum. It ends at the first record that is not whole, or goes on behind it where that is asked for.
"""

from __future__ import annotations

import os
import re
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
_INDEX_HEAD, _INDEX_ENTRY = struct.Struct("<HI"), 16
_FOOTER_SIZE = 20
_RESUMPTION = re.compile(rb"\x06|\x0f\x04\0\0\0\0\0\0\0", re.DOTALL)
"""Beginning of a chunk, or end of the data section: where reading may go on behind damage."""
_OPCODES = frozenset(range(Opcode.HEADER, Opcode.DATA_END + 1)) | frozenset(range(0x80, 0x100))
"""Kinds of records: those of the format, and of private extensions."""
_SCAN = 1 << 20
"""Bytes searched at a time for one of them."""


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


class Damage(NamedTuple):
    """A stretch of the file that cannot be read, with sound records behind it or at its end."""

    start: int
    """Byte."""
    reason: str
    messages: dict[int, int]
    """Messages lost, by channel: those that the index behind a damaged chunk counts."""


class _UnsoundError(Exception):
    """A record that cannot be trusted."""


class _CutError(_UnsoundError):
    """A record that is longer than the file."""


class McapStream:
    """Iterates once over the records of an MCAP file. Iterating never raises for what the file holds."""

    def __init__(self, file: IO[bytes], *, past_damage: bool = False) -> None:
        """Prepare to read.

        Args:
            past_damage: go on behind records that are not sound, with the next one that is. The schemas and channels
                of a finished file are then given again from its index: the lost chunk may have held them.
        """
        self._file = file
        self._past_damage = past_damage
        self._is_behind_damage = False
        self._size = file.seek(0, os.SEEK_END)
        self.is_mcap = False
        """The file starts as an MCAP file does; known once iteration has begun."""
        self.is_complete = False
        """Every record was sound, to the index of a finished file; known once iteration has ended."""
        self.damage = ""
        """Description of what is not sound, and at which byte; empty for a complete file."""
        self.damages: list[Damage] = []
        """The damage so far, place by place. A file that merely ends too early is cut, not damaged."""

    def __iter__(self) -> Iterator[Record]:
        self._file.seek(0)
        self.is_mcap = self._file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC
        if not self.is_mcap:
            self.damage = "not an MCAP file" if self._size else "the file is empty"
            return
        is_behind_data = False
        while True:
            start = self._file.tell()
            try:
                opcode, body = self._next_record(start)
                if opcode == Opcode.DATA_END:
                    is_behind_data = True
                    self._skip_summary()
                    self.is_complete = not self.damages
                    return
                if opcode == Opcode.MESSAGE_INDEX and self._past_damage:
                    self._count_lost(body)
                records = _records(opcode, body)
                self._is_behind_damage &= opcode != Opcode.CHUNK
                yield from records
            except _UnsoundError as error:
                if is_behind_data:  # which costs no message
                    self._say(str(error), start)
                    return
                resumed = self._past_damage and self._resume(start)
                is_cut = isinstance(error, _CutError)
                reason = "damaged (length of a record)" if is_cut and resumed else str(error)
                self._say(reason, start)
                if resumed or not is_cut:
                    self.damages.append(Damage(start, reason, {}))
                    self._is_behind_damage = True
                if not resumed:
                    return
                if len(self.damages) == 1:
                    yield from self._definitions()

    def _say(self, reason: str, start: int) -> None:
        self.damage += f"{'; ' if self.damage else ''}{reason} at byte {start} of {self._size}"

    def _resume(self, start: int) -> bool:
        """Go to the first record behind the one at `start` that is likely to be sound; whether there is one."""
        self._file.seek(start)
        try:
            opcode, length = _RECORD.unpack(self._file.read(_RECORD.size))
        except struct.error:
            return False
        end = start + _RECORD.size + length
        if opcode and end < self._size and self._is_record(end):
            self._file.seek(end)
            return True
        position = start + 1
        while position < self._size:
            self._file.seek(position)
            for match in _RESUMPTION.finditer(self._file.read(_SCAN + _RECORD.size)):
                if self._is_record(position + match.start(), sound=True):
                    self._file.seek(position + match.start())
                    return True
            position += _SCAN
        return False

    def _is_record(self, start: int, *, sound: bool = False) -> bool:
        """Return whether a record begins at this byte, by its first bytes or, if `sound`, by all that it holds."""
        self._file.seek(start)
        try:
            if not sound:
                opcode, length = _RECORD.unpack(self._file.read(_RECORD.size))
                return opcode in _OPCODES and length <= self._size - start - _RECORD.size
            opcode, body = self._next_record(start)
            _records(opcode, body)
        except (_UnsoundError, struct.error):
            return False
        return True

    def _definitions(self) -> list[Record]:
        """Return the schemas and channels in the index of a finished file; none of another."""
        here, found = self._file.tell(), list[Record]()
        try:
            tail = self._file.seek(max(self._size - _RECORD.size - _FOOTER_SIZE - len(MCAP0_MAGIC), 0))
            opcode, body = self._next_record(tail)
            position = int.from_bytes(body[:8], "little") if opcode == Opcode.FOOTER else 0
            while 0 < position < tail:
                self._file.seek(position)
                opcode, body = self._next_record(position)
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    found += _records(opcode, body)
                position = self._file.tell()
        except _UnsoundError:
            pass
        self._file.seek(here)
        return found

    def _count_lost(self, body: bytes) -> None:
        """Take note of what a damaged chunk held, from the index of it that follows."""
        try:
            channel, size = _INDEX_HEAD.unpack_from(body)
        except struct.error:
            size = -1
        if size != len(body) - _INDEX_HEAD.size:
            raise _UnsoundError("damaged (index of a chunk)")
        if self._is_behind_damage:
            self.damages[-1].messages[channel] = size // _INDEX_ENTRY

    def _next_record(self, start: int) -> tuple[int, bytes]:
        head = self._file.read(_RECORD.size)
        if len(head) < _RECORD.size:
            raise _CutError("cut")
        opcode, length = _RECORD.unpack(head)
        if opcode == 0:
            raise _UnsoundError("damaged (no record)")  # a file system's zeros after a power cut
        if self._past_damage and opcode not in _OPCODES:
            raise _UnsoundError(f"damaged (a record of kind {opcode})")
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
