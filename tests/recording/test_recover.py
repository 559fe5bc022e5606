"""Recovery: a cut file becomes one that every reader opens, with everything up to the cut."""

import pytest
from recording_samples import bits, make_header, make_tick, write_recording
from rosbags.highlevel import AnyReader

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Event
from humanoid_sim.recording import recorder as recorder_module
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.recording.recover import default_output, recover

COUNT = 200


@pytest.fixture
def cut(tmp_path, monkeypatch):
    """A recording of some chunks whose writer never came to the index, and whose last chunk is half written."""
    path = tmp_path / "run.mcap"
    monkeypatch.setattr(recorder_module, "FLUSH_PERIOD", 0.0)
    recorder = McapRecorder(path)
    recorder.start(make_header())
    for index in range(COUNT):
        recorder.tick(make_tick(index))
    recorder.event(Event(1.0, "last words"))
    recorder.close()
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 5])
    return path


def read_with_rosbags(path):
    with AnyReader([path]) as reader:
        return [(c.topic, time, bytes(data)) for c, time, data in reader.messages()], len(reader.connections)


def test_a_recovered_file_opens_everywhere(cut):
    with pytest.raises(Exception, match=r"(?i)magic"):
        read_with_rosbags(cut)
    before = open_recording(cut)
    ticks = [bits(tick) for tick in before.ticks()]
    assert 50 < len(ticks) < COUNT
    result = recover(cut, default_output(cut))
    assert result.output == cut.with_name("run.recovered.mcap")
    assert not result.was_complete
    assert "cut at byte" in result.damage

    recovered = open_recording(result.output)
    assert [bits(tick) for tick in recovered.ticks()] == ticks == [bits(make_tick(i)) for i in range(len(ticks))]
    assert recovered.is_complete
    assert recovered.header == make_header()
    messages, topics = read_with_rosbags(result.output)
    assert len(messages) == result.messages == sum(topic.messages for topic in before.topics.values())
    assert topics == len(before.topics)
    assert sum(topic == "/humanoid_sim/tick" for topic, _, _ in messages) == len(ticks)
    with AnyReader([result.output]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)


def test_a_complete_file_is_copied(tmp_path):
    path = tmp_path / "run.mcap"
    write_recording(path, [make_tick(index) for index in range(5)])
    result = recover(path, tmp_path / "copy.mcap")
    assert result.was_complete
    assert [bits(tick) for tick in open_recording(result.output).ticks()] == [bits(make_tick(i)) for i in range(5)]


def test_nothing_is_replaced_unasked(cut):
    output = cut.with_name("other.mcap")
    output.write_text("precious")
    with pytest.raises(InputError, match=r"other\.mcap' exists; choose another name, or add --overwrite"):
        recover(cut, output)
    assert output.read_text() == "precious"
    recover(cut, output, overwrite=True)
    assert open_recording(output).header.robot == "lite"
    with pytest.raises(InputError, match="is the file to recover"):
        recover(cut, cut, overwrite=True)


def test_a_file_without_messages_leaves_nothing_behind(tmp_path):
    path = tmp_path / "run.mcap"
    write_recording(path, [])
    for data, reason in ((path.read_bytes(), "it holds no messages"), (b"", "the file is empty"), (b"text", "not an")):
        path.write_bytes(data)
        with pytest.raises(InputError, match=f"nothing to recover: {reason}"):
            recover(path, default_output(path))
    with pytest.raises(InputError, match="no such file"):
        recover(tmp_path / "gone.mcap", tmp_path / "out.mcap")
    with pytest.raises(InputError, match="is a directory"):
        recover(tmp_path, tmp_path / "out.mcap")
    with pytest.raises(InputError, match="does not exist"):
        recover(path, tmp_path / "missing" / "out.mcap")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.mcap"]
