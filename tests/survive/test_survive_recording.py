"""A recording repeats bit for bit, and that of a killed run reads to its last whole chunk."""

from dataclasses import replace

import numpy as np
import onnx
import pytest
from control_run import bits
from control_surface import (
    TICK_TOPIC,
    TRAINER_SAMPLES,
    play,
    recorded_ticks,
    replay,
    replay_policy,
    shipped_policy,
    start_recording,
)
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from onnx import numpy_helper
from rosbags.highlevel import AnyReader

from humanoid_sim.messages import Mode, SafetyLevel, SafetyStatus

SCRIPT = "hold 0.05; damp; hold 0.1; load_a; wait; start_locomotion; hold 0.5; damp; hold 0.1"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run of the shipped policy on the Lite."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    options = ("--robot", "lite", "--policy", "lite_tracking", "--motion", "wave", "--script", SCRIPT)
    assert play(*options, "--record", str(path)) == 0
    return path


@pytest.fixture(scope="module")
def ticks(recorded):
    return recorded_ticks(recorded)


def first_in(mode, ticks):
    return next(tick.index for tick in ticks if tick.output.control_mode.mode is mode)


def test_a_run_repeats_bit_for_bit(recorded, ticks):
    modes = list(dict.fromkeys(tick.output.control_mode.mode.name for tick in ticks))
    assert modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION"]
    repeated = replay(recorded)
    assert repeated.is_identical
    assert repeated.is_complete
    assert repeated.ticks == len(ticks) > 1000
    assert replay_policy(recorded, shipped_policy("lite_tracking")).is_identical


def changed_byte(given, byte):
    """Change one byte of an elbow's position; 0 is the lowest of eight."""
    position = np.array(given.state.joint_position)
    position.view(np.uint8)[8 * 3 + byte] ^= 0x01
    return replace(given, state=replace(given.state, joint_position=position))


CHANGES = {
    "the last bit of a position, at LOAD_A": (Mode.STANDBY, lambda given: changed_byte(given, 0)),
    "a byte of a position, at START_LOCOMOTION": (Mode.LOCOMOTION, lambda given: changed_byte(given, 6)),
    "an intent that is missing": (Mode.STANDBY, lambda given: replace(given, intents=())),
    "a safety level": (
        Mode.LOCOMOTION,
        lambda given: replace(given, safety=(SafetyStatus(SafetyLevel.WARNING, source="simulation"),)),
    ),
}


@pytest.mark.parametrize(("mode", "change"), CHANGES.values(), ids=CHANGES)
def test_a_changed_input_is_named_with_its_tick(recorded, ticks, tmp_path, mode, change):
    index = first_in(mode, ticks)
    recorder = start_recording(tmp_path / "changed.mcap", recorded)
    for tick in ticks[: index + 50]:
        recorder.tick(replace(tick, input=change(tick.input)) if tick.index == index else tick)
    recorder.close()
    repeated = replay(tmp_path / "changed.mcap")
    assert not repeated.is_identical
    assert (repeated.ticks, repeated.first_tick) == (index, index)


def test_another_policy_is_named_with_its_first_tick(recorded, ticks, tmp_path):
    model = onnx.load(shipped_policy("lite_tracking"))
    last = model.graph.initializer[-1]
    last.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(last) + np.float32(0.125), last.name))
    trained = [entry for entry in model.metadata_props if entry.key == TRAINER_SAMPLES]
    for entry in trained:
        model.metadata_props.remove(entry)  # this policy was not trained, and would be refused as wired wrongly
    onnx.save(model, tmp_path / "other.onnx")
    compared = replay_policy(recorded, tmp_path / "other.onnx")
    assert not compared.is_identical
    assert compared.first_tick == first_in(Mode.LOCOMOTION, ticks)


@pytest.fixture(scope="module")
def ends(recorded):
    """Byte at which each chunk of the file ends, and the number of ticks up to there."""
    found, count, channel = [], 0, None
    with recorded.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                for inner in breakup_chunk(record):
                    if isinstance(inner, Channel) and inner.topic == TICK_TOPIC:
                        channel = inner.id
                    count += isinstance(inner, Message) and inner.channel_id == channel
                found.append((file.tell(), count))
    return found


@pytest.mark.parametrize(
    ("chunk", "further"),
    [(0, 0), (0, 1), (3, 0), (3, 200), (-2, 1000), (-1, 100)],
    ids=str,
)
def test_a_killed_run_reads_to_its_last_whole_chunk(recorded, ticks, ends, tmp_path, chunk, further):
    end, count = ends[chunk]
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: end + further])
    read = recorded_ticks(cut)
    assert len(read) >= count > 0
    assert [tick.index for tick in read] == list(range(len(read)))
    for whole, left in zip(ticks, read, strict=False):
        assert bits(whole.output.command) == bits(left.output.command)
        assert whole.input.state.joint_position.tobytes() == left.input.state.joint_position.tobytes()
    repeated = replay(cut)
    assert repeated.is_identical
    assert (repeated.ticks, repeated.is_complete) == (len(read), False)


def test_a_crash_loses_less_than_half_a_second(ends, ticks):
    counts = [0, *(count for _, count in ends)]
    assert counts[-1] == len(ticks)
    assert max(np.diff(counts)) < 100, "at 200 Hz"


def test_a_damaged_chunk_is_no_repetition(recorded, ends, tmp_path):
    data = bytearray(recorded.read_bytes())
    data[(ends[4][0] + ends[5][0]) // 2] ^= 0xFF
    (tmp_path / "damaged.mcap").write_bytes(data)
    repeated = replay(tmp_path / "damaged.mcap")
    assert not repeated.is_identical
    assert repeated.ticks >= ends[4][1]


def test_other_programs_read_it(recorded, ticks):
    with AnyReader([recorded]) as reader:
        seen = {connection.topic: connection.msgtype for connection in reader.connections}
        kinds = {
            "/lite/joint_states": "sensor_msgs/msg/JointState",
            "/imu/data": "sensor_msgs/msg/Imu",
            "/control_mode": "humanoid_control_msgs/msg/ControlMode",
            "/standby_controller_a/state": "humanoid_control_msgs/msg/StandbyState",
            "/safety_status": "humanoid_control_msgs/msg/SafetyStatus",
        }
        assert {topic: seen.get(topic) for topic in kinds} == kinds
        read = {topic: [] for topic in kinds}
        for connection, _, data in reader.messages():
            if connection.topic in read:
                read[connection.topic].append(reader.deserialize(data, connection.msgtype))
    assert list(dict.fromkeys(message.mode for message in read["/control_mode"])) == [0, 1, 2, 3]
    joint_states = read["/lite/joint_states"]
    assert joint_states[0].name[:4] == [
        "left_shoulder_pitch",
        "left_shoulder_roll",
        "left_shoulder_yaw",
        "left_elbow_pitch",
    ]
    first = ticks[0].input.state
    assert joint_states[0].position.tolist() == first.joint_position.tolist()
    assert read["/imu/data"][0].orientation.w == first.imu_quaternion[0]
    assert read["/standby_controller_a/state"][-1].is_finished
    assert {message.level for message in read["/safety_status"]} == {0}


def test_a_floating_robot_is_not_handed_to_a_remote_that_sends_nothing(tmp_path):
    path = tmp_path / "run.mcap"
    script = "damp; load_a; wait; start_remote; hold 0.1; damp"
    assert play("--robot", "lite_biped", "--script", script, "--record", str(path)) == 0
    modes = [tick.output.control_mode for tick in recorded_ticks(path)]
    assert Mode.STANDBY in {mode.mode for mode in modes}
    assert Mode.REMOTE not in {mode.mode for mode in modes}
    assert any("START_REMOTE refused" in mode.status_message for mode in modes)
