"""Reading what is left of a recording: a prefix of its ticks, or one line that says why not; never a wrong tick."""

import pytest
from mcap.writer import CompressionType, Writer
from recording_samples import make_header, make_tick

from humanoid_sim.errors import InputError
from humanoid_sim.recording.codec import encode_tick
from humanoid_sim.recording.header import write_header
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.ros2.definitions import SCHEMA_ENCODING, TICK
from humanoid_sim.ros2.topics import TICK_TOPIC

COUNT = 4


def small_recording(path):
    """Two chunks of two ticks, without the schemas' long texts: small enough to cut at every byte."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile="ros2", library="test")
        write_header(writer, make_header(attachments={"motion.mcap": b"motion"}))
        channel = writer.register_channel(TICK_TOPIC, "cdr", writer.register_schema(TICK, SCHEMA_ENCODING, b""))
        for index in range(COUNT):
            writer.add_message(channel, index, encode_tick(make_tick(index)), index)
            if index == 1:
                writer.flush()
        writer.finish()
    return path.read_bytes()


def test_what_is_no_recording_is_refused(tmp_path):
    empty, text, directory, foreign = (tmp_path / name for name in ("empty", "text", "directory", "foreign"))
    empty.touch()
    text.write_text("time, position\n")
    directory.mkdir()
    with foreign.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        writer.finish()
    reasons = {
        empty: "cut at byte 0",
        text: "not a valid MCAP file",
        directory: "is a directory, expected a recording (.mcap)",
        foreign: "no recording: it has no metadata record 'humanoid_sim.session'",
        tmp_path / "gone": "no such file, expected a recording (.mcap)",
    }
    for path, reason in reasons.items():
        with pytest.raises(InputError) as caught:
            open_recording(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert reason in str(caught.value)
