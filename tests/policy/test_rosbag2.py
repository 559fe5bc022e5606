"""Motions in bags that `rosbags`, an independent writer of rosbag2's format, has written."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import read_motion

STORE = get_typestore(Stores.LATEST)
ROWS = np.random.default_rng(0).normal(size=(5, 18)).astype(np.float32)


def write_bag(folder, topics=("/motion",), *, text=False):
    array = STORE.types["std_msgs/msg/Float32MultiArray"]
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for number, topic in enumerate(topics):
            connection = writer.add_connection(topic, array.__msgtype__, typestore=STORE)
            for index, row in enumerate(ROWS + number):
                data = STORE.serialize_cdr(array(layout=layout, data=row), array.__msgtype__)
                writer.write(connection, 1_000 + index * 20_000_000, data)
        if text:
            string = STORE.types["std_msgs/msg/String"]
            connection = writer.add_connection("/rosout", string.__msgtype__, typestore=STORE)
            writer.write(connection, 5, STORE.serialize_cdr(string(data="hello"), string.__msgtype__))
    return folder


def test_a_bag_with_one_topic_is_a_motion(tmp_path):
    motion = read_motion(write_bag(tmp_path / "bag"))
    assert motion.frames.tobytes() == ROWS.tobytes()
    assert motion.policy_dt == 0.02


def test_the_topic_is_named_where_there_are_others(tmp_path):
    bag = write_bag(tmp_path / "bag", ("/other", "/motion"), text=True)
    with pytest.raises(InputError, match=r"/bag: has the topics '/other' and '/motion', expected exactly one; `play"):
        read_motion(bag)
    assert read_motion(bag, "/motion").frames.tobytes() == (ROWS + 1).tobytes()
    with pytest.raises(InputError, match=r"/bag: unknown topic '/moton' \(did you mean '/motion'\?\); known: /other"):
        read_motion(bag, "/moton")
    with pytest.raises(
        InputError, match=r"/bag: topic '/rosout' is std_msgs/msg/String \(cdr\), expected one topic of"
    ):
        read_motion(bag, "/rosout")


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (("storage_identifier: mcap", "storage_identifier: sqlite3"), "storage_identifier: is 'sqlite3', expected"),
        (("relative_file_paths:", "relative_file_paths: 3\n  x:"), "relative_file_paths: is 3, expected the names"),
        (("rosbag2_bagfile_information:", "something_else:"), "has no rosbag2_bagfile_information"),
        (("bag.mcap", "gone.mcap"), "gone.mcap: no such file, expected a file of the bag"),
    ],
)
def test_a_damaged_bag_is_one_line(tmp_path, change, why):
    bag = write_bag(tmp_path / "bag")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    assert change[0] in text
    metadata.write_text(text.replace(*change))
    with pytest.raises(InputError, match=why):
        read_motion(bag)
