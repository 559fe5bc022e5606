"""The library's writer is the reference: the same calls make the same file, byte for byte."""

import io
import tracemalloc

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from humanoid_sim.ros2 import mcap_writer
from humanoid_sim.ros2.mcap_writer import ChunkedWriter


def write(writer, *, messages, flush_every=10**9, seed=1, length=900):
    rng = np.random.default_rng(seed)
    writer.start(profile="ros2", library="test")
    writer.add_attachment(5, 6, "motion.mcap", "application/octet-stream", rng.bytes(5000))
    writer.add_metadata("documents", {"robot": "{}", "ä": "ö" * 300})
    writer.add_metadata("session", {})
    schemas = [writer.register_schema(f"a/msg/{name}", "ros2msg", name.encode() * 40) for name in "AB"]
    channels = []
    for k in range(messages):
        if k % 37 == 0 and len(channels) < 12:
            channels.append(
                writer.register_channel(f"/topic{k}", "cdr", schemas[k % 2], {"offered_qos_profiles": "x" * k})
            )
        channel = channels[int(rng.integers(len(channels)))]
        time = 1_000_000 * k - int(rng.integers(3_000_000)) * (k > 10)
        writer.add_message(channel, time, rng.bytes(int(rng.integers(length))), time + 1, k & 0xFFFFFFFF)
        if k % flush_every == flush_every - 1:
            writer.flush()
    writer.finish()


CASES = [
    {"messages": 0},
    {"messages": 1},
    {"messages": 700, "flush_every": 60},
    {"messages": 700, "flush_every": 1, "seed": 3},
    {"messages": 4000},  # chunks that end because they are full
    {"messages": 300, "length": 1, "seed": 4},
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_file_is_that_of_the_library(case):
    ours, theirs = io.BytesIO(), io.BytesIO()
    write(ChunkedWriter(ours), **case)
    write(Writer(theirs, compression=CompressionType.LZ4), **case)
    assert ours.getvalue() == theirs.getvalue()


def test_an_hour_of_chunks_needs_a_few_megabytes():
    """A recording has three a second, and keeps where each is until it ends."""

    class Nowhere(io.RawIOBase):
        def write(self, data):
            return len(data)

        def tell(self):
            return 0

    def chunks(count):
        for k in range(count):
            for channel in channels:
                writer.add_message(channel, k, b"", k)
            writer.flush()

    writer = ChunkedWriter(Nowhere())
    writer.start("ros2", "test")
    schema = writer.register_schema("a", "ros2msg", b"")
    channels = [writer.register_channel(f"/{name}", "cdr", schema) for name in range(16)]
    chunks(50)
    tracemalloc.start()
    chunks(200)
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert size < 200 * 400


def test_the_library_reads_it():
    file = io.BytesIO()
    write(ChunkedWriter(file), messages=4000)
    file.seek(0)
    reader = make_reader(file, validate_crcs=True)
    summary = reader.get_summary()
    assert (summary.statistics.message_count, summary.statistics.chunk_count) == (4000, len(summary.chunk_indexes))
    assert len(summary.chunk_indexes) > 1
    times = [message.log_time for _, _, message in reader.iter_messages(topics=["/topic37"])]
    assert times == sorted(times)
    assert len(times) > 100


def test_what_does_not_fit_its_field_is_refused_and_changes_nothing():
    ours, rest = io.BytesIO(), io.BytesIO()
    for file, is_tried in ((ours, True), (rest, False)):
        writer = ChunkedWriter(file)
        writer.start("", "")
        writer.register_channel("/a", "cdr", 0)
        writer.add_message(1, 5, b"one", 5)
        if is_tried:
            with pytest.raises(mcap_writer.struct.error):
                writer.add_message(1, -1, b"two", 5)
        writer.finish()
    assert ours.getvalue() == rest.getvalue()
