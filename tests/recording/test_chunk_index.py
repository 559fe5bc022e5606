"""The index of the chunks in a file: the recording is the same byte for byte, and memory holds none of it."""

from __future__ import annotations

import gc
from collections.abc import Callable
from io import BytesIO

from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from humanoid_sim.recording.chunk_index import keep_index_in_file

CHUNKS = 300


def written(prepare: Callable[[Writer], object]) -> tuple[bytes, int]:
    """A file of many chunks, and how many of their indexes were in memory before it was finished."""
    file = BytesIO()
    writer = Writer(file, compression=CompressionType.LZ4)
    kept = prepare(writer)
    writer.start(profile="ros2", library="test")
    channels = [writer.register_channel(f"/topic_{i}", "cdr", 0, {}) for i in range(3)]
    for chunk in range(CHUNKS):
        for channel in channels[: 1 + chunk % 3]:
            writer.add_message(channel, 1000 * chunk + channel, bytes([chunk % 256]) * 40, 1000 * chunk, chunk)
        writer.flush()
    held = sum(isinstance(thing, ChunkIndex) for thing in gc.get_objects())
    writer.finish()
    del kept
    return file.getvalue(), held


def test_the_file_is_the_same_and_memory_holds_no_index() -> None:
    usual, held = written(id)
    assert held == CHUNKS

    def in_file(writer: Writer) -> None:
        index = keep_index_in_file(writer)
        closing.append(index.close)

    closing: list[Callable[[], None]] = []
    kept_in_file, held = written(in_file)
    for close in closing:
        close()
    assert held == 0
    assert kept_in_file == usual
    summary = make_reader(BytesIO(kept_in_file)).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == CHUNKS
