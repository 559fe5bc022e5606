"""The recorder: everything is in the file, nothing waits for the disk, and a dying disk or process costs little."""

import itertools
import threading
from dataclasses import replace

import numpy as np
import pytest
from mcap.writer import Writer
from recording_samples import START_NS, make_header, make_tick, write_recording
from rosbags.highlevel import AnyReader
from waiting import until

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Event, EventKind, RemoteCommand, SafetyFlag, SafetyLevel, SafetyStatus, TickRecord
from humanoid_sim.mit import MITCommand
from humanoid_sim.recording import recorder as recorder_module
from humanoid_sim.recording import sink
from humanoid_sim.recording.header import header_fields, json_document, parse_header
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.testing.properties import fingerprint


def read_topics(path):
    """Every message of a file by topic, as an independent reader sees it: (time in ns, message)."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    return found


def with_input(record, **changes):
    return replace(record, input=replace(record.input, **changes))


def test_all_ticks_and_the_header_come_back(tmp_path):
    ticks = [make_tick(index) for index in range(120)]
    write_recording(tmp_path / "run.mcap", ticks, events=[(0.6, "the hand let go")])
    recording = open_recording(tmp_path / "run.mcap")
    assert recording.header == make_header()
    entries = list(recording.entries())
    assert [fingerprint(entry) for entry in entries[:-1]] == [fingerprint(tick) for tick in ticks]
    assert entries[-1] == Event(0.6, "the hand let go")
    assert recording.is_complete
    assert recording.damage == ""


def test_an_independent_reader_sees_the_topics(tmp_path):
    path = tmp_path / "run.mcap"
    ticks = [make_tick(index) for index in range(80)]
    fault = SafetyStatus(SafetyLevel.FAULT, SafetyFlag.MOTOR_FAULT, "can0", "motor 3")
    remote = RemoteCommand(MITCommand.zeros(3), 0.25)
    ticks[50] = with_input(ticks[50], safety=(*ticks[50].input.safety, fault))
    ticks[60:] = [with_input(tick, remote=remote) for tick in ticks[60:]]
    write_recording(path, ticks)
    topics = read_topics(path)

    every_fourth = ticks[::4]
    assert [time_ns for time_ns, _ in topics["/lite/joint_states"]] == [START_NS + 20_000_000 * k for k in range(20)]
    for (_, message), tick in zip(topics["/mit_command"], every_fourth, strict=True):
        assert np.array_equal(message.damping, tick.output.command.damping)
    standby = [message.is_finished for _, message in topics["/standby_controller_a/state"]]
    assert standby == [False] * (len(standby) - 1) + [True]
    safety = [(message.source, message.level, message.flags) for _, message in topics["/safety_status"]]
    assert safety == [("simulation", 0, 0), ("can0", 2, 8), ("can0", 0, 0)], "the last: no source speaks of can0"
    steps = [tick.output.policy_step for tick in ticks if tick.output.policy_step]
    observations = [message for _, message in topics["/rl_policy_controller/observation"]]
    assert observations[0].name == ["joint_pos/0", "joint_pos/1", "joint_pos/2", "actions/0", "actions/1"]
    assert np.array_equal([message.position for message in observations], [step.observation for step in steps])
    counts = [
        len(topics[name]) for name in ("/control_mode", "/remote_policy_controller/command", "/humanoid_sim/tick")
    ]
    assert counts == [20, 1, 80]


def test_a_disk_that_fills_up_ends_the_recording_only(tmp_path, monkeypatch):
    written = []

    def write(self, data):
        if written and sum(written) > 10_000:
            raise OSError(28, "No space left on device")
        written.append(len(data))
        return original(self, data)

    original = recorder_module._UnbufferedFile.write
    monkeypatch.setattr(recorder_module._UnbufferedFile, "write", write)
    monkeypatch.setattr(recorder_module, "FLUSH_PERIOD", 0.01)
    told = []
    recorder = McapRecorder(tmp_path / "run.mcap", tell=told.append)
    recorder.start(make_header())
    indices = itertools.count()
    until(lambda: recorder.tick(make_tick(next(indices))) or recorder.error)
    assert recorder.error == f"{tmp_path / 'run.mcap'}: recording stopped: No space left on device"
    recorder.tick(make_tick(next(indices)))
    recorder.event(Event(0.0, "still running"))
    recorder.close()
    assert told == [recorder.error]
    recorder.close()
    read = list(open_recording(tmp_path / "run.mcap").ticks())
    assert [fingerprint(tick) for tick in read] == [fingerprint(make_tick(index)) for index in range(len(read))]
    assert len(read) > 0


def test_a_writer_that_cannot_keep_up_leaves_a_gap_and_says_so(tmp_path, monkeypatch):
    may_write = threading.Event()
    begun = threading.Event()
    original = McapRecorder.handle_tick

    def slow(self, record):
        begun.set()
        may_write.wait(60.0)
        original(self, record)

    monkeypatch.setattr(McapRecorder, "handle_tick", slow)
    monkeypatch.setattr(sink, "QUEUE_LIMIT", 8)
    recorder = McapRecorder(tmp_path / "run.mcap")
    recorder.start(make_header())
    recorder.tick(make_tick(0))
    begun.wait(60.0)
    for index in range(1, 20):
        recorder.tick(make_tick(index))
    assert recorder.lost == 11
    may_write.set()
    until(lambda: not recorder._queue)
    recorder.tick(make_tick(20))
    recorder.close()
    entries = list(open_recording(tmp_path / "run.mcap").entries())
    assert [entry.index for entry in entries if isinstance(entry, TickRecord)] == [*range(9), 20]
    assert [(entry.text, entry.kind) for entry in entries if isinstance(entry, Event)] == [
        ("recording: 11 ticks left out before tick 20", EventKind.LOSS),
    ]


def test_a_file_that_another_session_writes_is_left_alone(tmp_path):
    path = tmp_path / "run.mcap"
    first, second = McapRecorder(path), McapRecorder(path)
    first.start(make_header())
    with pytest.raises(InputError, match=r"run\.mcap: is being written by another session"):
        second.start(make_header())
    first.tick(make_tick(0))
    first.close()
    assert len(list(open_recording(path).ticks())) == 1
    write_recording(path, [make_tick(0), make_tick(1)])
    assert len(list(open_recording(path).ticks())) == 2


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
        empty: "no recording: cut at byte 0, before its header",
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


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"control_period": "0"}, "control_period is 0"),
        ({"control_period": "nan"}, "control_period is nan"),
        ({"start_time_ns": str(10**30)}, "start_time_ns 10000"),
    ],
)
def test_a_header_that_cannot_be_is_damaged(changes, reason):
    header = make_header()
    with pytest.raises(InputError, match=f"^x: header is damaged: .*{reason}"):
        parse_header("x", header_fields(header) | changes, header.documents, header.attachments)
    with pytest.raises(InputError, match="document 'labels' is damaged"):
        json_document(make_header(documents={"labels": "[]"}), "labels")


def test_ticks_of_other_joints_than_the_header_s_are_refused(tmp_path):
    write_recording(tmp_path / "run.mcap", [make_tick(0)], make_header(joint_names=("hip", "knee")))
    with pytest.raises(InputError, match=r"its ticks have joints of shape \(3,\), its header others"):
        open_recording(tmp_path / "run.mcap").columns()
