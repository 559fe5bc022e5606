"""Motion files: what is written is read back, and a bad file is refused with one line."""

from io import BytesIO

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader

from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.motion import Motion, motion_bytes, read_motion
from humanoid_sim.ros2.definitions import FLOAT32_MULTI_ARRAY, schema_text
from humanoid_sim.ros2.messages import encode_float32_array

BODIES = ("left_hand", "right_hand")


def make_motion(frames=7, policy_dt=0.02):
    values = np.random.default_rng(0).normal(size=(frames, 18)).astype(np.float32)
    return Motion(frames=values, body_names=BODIES, policy_dt=policy_dt, task_type="tracking", robot="lite")


def foreign_file(rows, times=None, *, schema=FLOAT32_MULTI_ARRAY, topics=("/reference",), metadata=None, zstd=True):
    """A motion file as another program would write it."""
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.ZSTD if zstd else CompressionType.NONE)
    writer.start(profile="ros2")
    if metadata is not None:
        writer.add_metadata("motion", metadata)
    schema_id = writer.register_schema(schema, "ros2msg", schema_text(FLOAT32_MULTI_ARRAY).encode())
    channels = [writer.register_channel(topic, "cdr", schema_id) for topic in topics]
    for index, row in enumerate(rows):
        data = row if isinstance(row, bytes) else encode_float32_array(np.asarray(row, np.float32))
        time = times[index] if times is not None else index * 20_000_000
        writer.add_message(channels[index % len(channels)], time, data, time)
    writer.finish()
    return stream.getvalue()


def test_round_trip(tmp_path):
    motion = make_motion()
    (tmp_path / "wave.mcap").write_bytes(motion_bytes(motion))
    read = read_motion(tmp_path / "wave.mcap")
    assert read.frames.tobytes() == motion.frames.tobytes()
    assert read.frames.dtype == np.float32
    assert read.frames.shape == (7, 18)
    assert (read.body_names, read.policy_dt, read.task_type, read.robot) == (BODIES, 0.02, "tracking", "lite")
    assert read.duration == pytest.approx(0.12)
    assert not read.frames.flags.writeable


def test_an_independent_reader_agrees(tmp_path):
    motion = make_motion()
    (tmp_path / "wave.mcap").write_bytes(motion_bytes(motion))
    with AnyReader([tmp_path / "wave.mcap"]) as reader:
        assert [connection.topic for connection in reader.connections] == ["/motion"]
        messages = list(reader.messages())
        values = [reader.deserialize(raw, connection.msgtype).data for connection, _, raw in messages]
    assert [time for _, time, _ in messages] == [index * 20_000_000 for index in range(7)]
    assert np.array_equal(np.stack(values), motion.frames)


@pytest.mark.parametrize("zstd", [True, False])
def test_a_file_of_another_writer(tmp_path, zstd):
    path = tmp_path / "other.mcap"
    path.write_bytes(foreign_file(np.ones((5, 88)), zstd=zstd))
    motion = read_motion(path)
    assert motion.frames.shape == (5, 88)
    assert (motion.body_names, motion.policy_dt, motion.task_type) == ((), 0.02, "")


ROWS = np.zeros((4, 18))
NAN = np.where(np.arange(72).reshape(4, 18) == 40, np.nan, 0.0)

BAD_FILES = {
    "empty": (b"", "the file is empty"),
    "text": (b"frames: 3\n", "not an MCAP file"),
    "truncated": (foreign_file(ROWS)[:-9], "cut at byte"),
    "no frames": (foreign_file([]), "holds no frames"),
    "wrong schema": (foreign_file(ROWS, schema="sensor_msgs/msg/Imu"), "topic '/reference' is sensor_msgs/msg/Imu"),
    "two topics": (foreign_file(ROWS, topics=("/a", "/b")), "has the topics '/a' and '/b', expected exactly one"),
    "ragged": (foreign_file([[1.0, 2.0], [1.0]]), "frame 1 has 1 values, the frames before 2"),
    "not finite": (foreign_file(NAN), "value 4 of frame 2 is nan"),
    "no values": (foreign_file([[], []]), "shape is (2, 0)"),
    "two episodes": (foreign_file(ROWS, times=[0, 20, 0, 20]), "time goes back at frame 2"),
    "no period": (foreign_file(ROWS, times=[0, 20, 25, 60]), "policy_dt: not in the metadata"),
    "bad period": (foreign_file(ROWS, metadata={"policy_dt": "fast"}), "policy_dt: is 'fast'"),
    "negative period": (foreign_file(ROWS, metadata={"policy_dt": "-1"}), "Motion.policy_dt: is -1.0"),
    "not CDR": (foreign_file([b"\x00\x01\x00\x00\x07"]), "frame 0 is not a std_msgs/msg/Float32MultiArray"),
    "bodies": (
        foreign_file(ROWS, metadata={"policy_dt": "0.02", "body_names": "hand", "task_type": "tracking"}),
        "18 values per frame, expected 9",
    ),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_is_refused(tmp_path, name):
    data, reason = BAD_FILES[name]
    path = tmp_path / "bad.mcap"
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_motion(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert reason in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"frames": np.zeros(18)}, "shape is (18,)"),
        ({"frames": np.zeros((2, 17))}, "17 values per frame, expected 18"),
        ({"frames": np.full((2, 18), np.inf)}, "value 0 of frame 0 is inf"),
        ({"policy_dt": 0.0}, "policy_dt: is 0.0"),
        ({"policy_dt": float("nan")}, "policy_dt: is nan"),
    ],
)
def test_a_wrong_motion_cannot_be_made(change, reason):
    fields = {"frames": np.zeros((2, 18)), "body_names": BODIES, "policy_dt": 0.02} | change
    with pytest.raises(FieldError) as caught:
        Motion(**fields)
    assert reason in str(caught.value)
