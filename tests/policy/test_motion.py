"""Motion files: what is written is read back, also by others and from others, and a bad file is one line."""

from io import BytesIO

import models
import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import zero_policy
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import MOTION_ATTACHMENT, Motion, motion_bytes, parse_motion, read_motion
from humanoid_sim.ros2.definitions import FLOAT32_MULTI_ARRAY, schema_text
from humanoid_sim.ros2.messages import encode_float32_array

VALUES = np.random.default_rng(0).normal(size=(7, 18)).astype(np.float32)
IN_BASE = Motion(VALUES, ("left_hand", "right_hand"), 0.02, "tracking", "lite")
IN_WORLD = Motion(
    np.arange(2.0 * 20).reshape(2, 20), ("pelvis", "torso"), 0.02, layout="joints_bodies_w", joint_names=models.JOINTS
)
STORE = get_typestore(Stores.LATEST)


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


@pytest.mark.parametrize("motion", [IN_BASE, IN_WORLD], ids=["in base", "in world"])
def test_round_trip(tmp_path, motion):
    (tmp_path / "wave.mcap").write_bytes(motion_bytes(motion))
    read = read_motion(tmp_path / "wave.mcap")
    assert (read.frames.tobytes(), read.frames.dtype) == (motion.frames.tobytes(), np.float32)
    for name in ("body_names", "joint_names", "layout", "policy_dt", "task_type", "robot"):
        assert getattr(read, name) == getattr(motion, name)


def test_an_independent_reader_agrees(tmp_path):
    (tmp_path / "wave.mcap").write_bytes(motion_bytes(IN_BASE))
    with AnyReader([tmp_path / "wave.mcap"]) as reader:
        assert [connection.topic for connection in reader.connections] == ["/motion"]
        messages = list(reader.messages())
        values = [reader.deserialize(raw, connection.msgtype).data for connection, _, raw in messages]
    assert [time for _, time, _ in messages] == [index * 20_000_000 for index in range(7)]
    assert np.array_equal(np.stack(values), VALUES)


@pytest.mark.parametrize("zstd", [True, False])
def test_a_file_of_another_writer(zstd):
    motion = parse_motion(foreign_file(np.ones((5, 88)), zstd=zstd), "other.mcap")
    assert motion.frames.shape == (5, 88)
    assert (motion.body_names, motion.policy_dt, motion.task_type) == ((), 0.02, "")


def test_of_a_recording_the_motion_of_the_last_policy_is_read():
    stream = BytesIO()
    writer = Writer(stream)
    writer.start()
    for motion in (IN_WORLD, IN_BASE):
        writer.add_attachment(0, 0, MOTION_ATTACHMENT, "application/octet-stream", motion_bytes(motion))
    channel = writer.register_channel(
        "/joint_states", "cdr", writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
    )
    writer.add_message(channel, 0, b"", 0)
    writer.finish()
    assert parse_motion(stream.getvalue(), "run.mcap").frames.tobytes() == VALUES.tobytes()


def write_bag(folder, topics=("/motion",)):
    """A folder of rosbag2, written by `rosbags`, with a text beside the motions."""
    array = STORE.types["std_msgs/msg/Float32MultiArray"]
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with BagWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for number, topic in enumerate(topics):
            connection = writer.add_connection(topic, array.__msgtype__, typestore=STORE)
            for index, row in enumerate(VALUES + number):
                data = STORE.serialize_cdr(array(layout=layout, data=row), array.__msgtype__)
                writer.write(connection, 1_000 + index * 20_000_000, data)
        if len(topics) > 1:
            string = STORE.types["std_msgs/msg/String"]
            connection = writer.add_connection("/rosout", string.__msgtype__, typestore=STORE)
            writer.write(connection, 5, STORE.serialize_cdr(string(data="hello"), string.__msgtype__))
    return folder


def test_a_folder_of_rosbag2(tmp_path):
    motion = read_motion(write_bag(tmp_path / "one"))
    assert (motion.frames.tobytes(), motion.policy_dt) == (VALUES.tobytes(), 0.02)
    bag = write_bag(tmp_path / "several", ("/other", "/motion"))
    assert read_motion(bag, "/motion").frames.tobytes() == (VALUES + 1).tobytes()
    for topic, words in {
        None: "--motion-topic",
        "/moton": "did you mean '/motion'",
        "/rosout": "std_msgs/msg/String",
    }.items():
        with pytest.raises(InputError, match=words):
            read_motion(bag, topic)
    with pytest.raises(InputError, match="is a directory, expected a motion file"):
        read_motion(tmp_path)


ROWS = np.zeros((4, 18))
NAN = np.where(np.arange(72).reshape(4, 18) == 40, np.nan, 0.0)
BAD_FILES = {
    "empty": (b"", "the file is empty"),
    "text": (b"frames: 3\n", "not an MCAP file"),
    "truncated": (foreign_file(ROWS)[:-9], "cut at byte"),
    "no frames": (foreign_file([]), "holds no frames"),
    "wrong schema": (foreign_file(ROWS, schema="sensor_msgs/msg/Imu"), "topic '/reference' is sensor_msgs/msg/Imu"),
    "two topics": (foreign_file(ROWS, topics=("/a", "/b")), "expected one topic of std_msgs/msg/Float32MultiArray"),
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
    "joints": (
        foreign_file(ROWS, metadata={"policy_dt": "0.02", "joint_names": "knee", "layout": "joints_bodies_w"}),
        "18 values per frame, expected 2",
    ),
    "layout": (foreign_file(ROWS, metadata={"policy_dt": "0.02", "layout": "x"}), "expected one of bodies_b, joints_b"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_is_one_line(name):
    data, reason = BAD_FILES[name]
    with pytest.raises(InputError) as caught:
        parse_motion(data, "bad.mcap")
    message = str(caught.value)
    assert message.startswith("bad.mcap: ")
    assert reason in message
    assert "\n" not in message


def test_a_policy_follows_its_own_order_of_the_files_joints():
    wiring = models.contract(
        task_type="tracking",
        joint_names=("c", "a", "b"),
        observation=("motion_command", "motion_anchor_ori_b"),
        body_names=IN_WORLD.body_names,
        anchor_body="torso",
    )
    reference = load_policy(wiring, zero_policy(2), IN_WORLD).reference
    assert reference.term("reference_joint_pos", 0).tolist() == [2.0, 0.0, 1.0]
    assert reference.term("reference_joint_vel", 0).tolist() == [5.0, 3.0, 4.0]
    assert reference.term("anchor_pos", 1).tolist() == [29.0, 30.0, 31.0]
    assert reference.term("anchor_quat", 1).tolist() == [36.0, 37.0, 38.0, 39.0]
