"""The index of a recording's chunks, kept in a file while the run goes on.

`mcap.writer.Writer` holds one object for every chunk until the file is finished. At three chunks a second that is 13 MB
an hour, all of it needed only at the end.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer

__all__ = ["ChunkIndexFile", "keep_index_in_file"]

_ATTRIBUTE = "_Writer__chunk_indices"
_RECORD_HEAD = 9
"""Bytes of operation code and length before each record's content."""


class ChunkIndexFile:
    """Takes the place of the writer's list: append to it, then iterate over it."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the recording

    def append(self, index: ChunkIndex) -> None:
        """Add the index of a chunk."""
        builder = RecordBuilder()
        index.write(builder)
        self._file.write(builder.end())

    def __iter__(self) -> Iterator[ChunkIndex]:
        size = self._file.seek(0, os.SEEK_END)
        self._file.seek(0)
        stream = ReadDataStream(self._file)
        while stream.count < size:
            stream.read(_RECORD_HEAD)
            yield ChunkIndex.read(stream)

    def close(self) -> None:
        """Give the file back."""
        self._file.close()


def keep_index_in_file(writer: Writer) -> ChunkIndexFile:
    """Have a writer that has not begun keep its chunk index in a file; the caller closes it after `finish`.

    This replaces an attribute that is the writer's own. Should a version of the library have none of that name, its
    memory grows as it does by itself, and the tests say so.
    """
    index = ChunkIndexFile()
    if hasattr(writer, _ATTRIBUTE):
        setattr(writer, _ATTRIBUTE, index)
    return index
