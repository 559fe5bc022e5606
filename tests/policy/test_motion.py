"""Motion files: what is written is read back, also by others and from others, and a bad file is one line."""

from io import BytesIO

import models
import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.highlevel import AnyReader

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


@pytest.mark.parametrize("motion", [IN_BASE, IN_WORLD], ids=["in base", "in world"])
def test_round_trip_also_through_an_independent_reader(tmp_path, motion):
    path = tmp_path / "wave.mcap"
    path.write_bytes(motion_bytes(motion))
    read = read_motion(path)
    assert (read.frames.tobytes(), read.frames.dtype) == (motion.frames.tobytes(), np.float32)
    for name in ("body_names", "joint_names", "layout", "policy_dt", "task_type", "robot"):
        assert getattr(read, name) == getattr(motion, name)
    with AnyReader([path]) as reader:
        messages = [(time, reader.deserialize(raw, at.msgtype).data) for at, time, raw in reader.messages()]
    assert [time for time, _ in messages] == [index * 20_000_000 for index in range(len(motion.frames))]
    assert np.array_equal([values for _, values in messages], motion.frames)


def test_of_a_recording_its_motion_is_read():
    stream = BytesIO()
    writer = Writer(stream)
    writer.start()
    writer.add_attachment(0, 0, MOTION_ATTACHMENT, "application/octet-stream", motion_bytes(IN_BASE))
    writer.finish()
    assert parse_motion(stream.getvalue(), "run.mcap").frames.tobytes() == VALUES.tobytes()


def foreign(rows, times=None, schema=FLOAT32_MULTI_ARRAY, **metadata):
    """A motion file as another program would write it."""
    stream = BytesIO()
    writer = Writer(stream)
    writer.start(profile="ros2")
    if metadata:
        writer.add_metadata("motion", metadata)
    schema_id = writer.register_schema(schema, "ros2msg", schema_text(FLOAT32_MULTI_ARRAY).encode())
    channel = writer.register_channel("/reference", "cdr", schema_id)
    for index, row in enumerate(rows):
        data = row if isinstance(row, bytes) else encode_float32_array(np.asarray(row, np.float32))
        time = times[index] if times else index * 20_000_000
        writer.add_message(channel, time, data, time)
    writer.finish()
    return stream.getvalue()


ROWS = np.zeros((4, 18))
BAD_FILES = {
    "text": (b"frames: 3\n", "is not a whole MCAP file"),
    "truncated": (foreign(ROWS)[:-9], "is not a whole MCAP file"),
    "no frames": (foreign([]), "has the topics none"),
    "wrong schema": (foreign(ROWS, schema="sensor_msgs/msg/Imu"), "has the topics none"),
    "not finite": (foreign([[0.0, 1.0], [0.0, np.nan]]), "value 1 of frame 1 is nan"),
    "two episodes": (foreign(ROWS, [0, 20, 0, 20]), "time goes back at frame 2"),
    "no period": (foreign(ROWS, [0, 20, 25, 60]), "policy_dt: not in the metadata"),
    "not CDR": (foreign([b"\x00\x01\x00\x00\x07"]), "frame 0 is not a std_msgs/msg/Float32MultiArray"),
    "bodies": (foreign(ROWS, body_names="hand", task_type="tracking"), "18 values per frame, expected 9"),
    "layout": (foreign(ROWS, layout="x"), "expected one of bodies_b, joints_b"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_is_one_line(name):
    data, reason = BAD_FILES[name]
    with pytest.raises(InputError, match=rf"^bad\.mcap: [^\n]*{reason}[^\n]*$"):
        parse_motion(data, "bad.mcap")


def test_a_motion_from_elsewhere_leads_to_prepare(tmp_path):
    (tmp_path / "dance.npz").write_bytes(b"PK")
    with pytest.raises(InputError, match=r"dance.npz: is not a motion file .*humanoid_sim.prepare --motion"):
        read_motion(tmp_path / "dance.npz")


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
