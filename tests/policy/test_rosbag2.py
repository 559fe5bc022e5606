"""Motions in bags that `rosbags`, an independent writer of rosbag2's format, has written."""

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import read_motion

STORE = get_typestore(Stores.LATEST)
ROWS = np.random.default_rng(0).normal(size=(5, 18)).astype(np.float32)


def write_bag(folder, storage, topics=("/motion",), *, compressed=False, text=False):
    array = STORE.types["std_msgs/msg/Float32MultiArray"]
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    bag = Writer(folder, version=9, storage_plugin=storage)
    if compressed:
        bag.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with bag as writer:
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


STORAGES = pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])


@STORAGES
def test_a_bag_with_one_topic_is_a_motion(tmp_path, storage):
    motion = read_motion(write_bag(tmp_path / "bag", storage))
    assert motion.frames.tobytes() == ROWS.tobytes()
    assert motion.policy_dt == 0.02


@STORAGES
def test_the_topic_is_named_where_there_are_others(tmp_path, storage):
    bag = write_bag(tmp_path / "bag", storage, ("/other", "/motion"), text=True)
    with pytest.raises(InputError, match=r"/bag: has the topics '/other' and '/motion', expected exactly one; `play"):
        read_motion(bag)
    assert read_motion(bag, "/motion").frames.tobytes() == (ROWS + 1).tobytes()
    with pytest.raises(InputError, match=r"/bag: unknown topic '/moton' \(did you mean '/motion'\?\); known: /other"):
        read_motion(bag, "/moton")
    with pytest.raises(
        InputError, match=r"/bag: topic '/rosout' is std_msgs/msg/String \(cdr\), expected one topic of"
    ):
        read_motion(bag, "/rosout")


def test_the_file_of_a_bag_is_a_motion_too(tmp_path):
    bag = write_bag(tmp_path / "bag", StoragePlugin.MCAP, ("/other", "/motion"))
    (file,) = bag.glob("*.mcap")
    assert read_motion(file, "/other").frames.tobytes() == ROWS.tobytes()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (("storage_identifier: sqlite3", "storage_identifier: leveldb"), "storage_identifier: is 'leveldb', expected"),
        (("relative_file_paths:", "relative_file_paths: 3\n  x:"), "relative_file_paths: is 3, expected the names"),
        (("rosbag2_bagfile_information:", "something_else:"), "has no rosbag2_bagfile_information"),
        (("bag.db3", "gone.db3"), "gone.db3: no such file, expected a file of the bag"),
    ],
)
def test_a_damaged_bag_is_one_line(tmp_path, change, why):
    bag = write_bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    assert change[0] in text
    metadata.write_text(text.replace(*change))
    with pytest.raises(InputError, match=why):
        read_motion(bag)


@pytest.mark.parametrize("content", [b"", b"no database", b"SQLite format 3\0" + bytes(2000)])
def test_a_file_that_is_not_a_database_is_one_line(tmp_path, content):
    bag = write_bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    (bag / "bag.db3").write_bytes(content)
    with pytest.raises(InputError, match=r"/bag/bag.db3: not a database of rosbag2: "):
        read_motion(bag)


def test_a_bag_that_is_compressed_as_a_whole_is_refused(tmp_path):
    bag = write_bag(tmp_path / "bag", StoragePlugin.SQLITE3, compressed=True)
    with pytest.raises(InputError, match=r"metadata.yaml: compression_mode: is 'file', expected a bag that is not"):
        read_motion(bag)


def test_a_folder_that_is_not_a_bag_is_refused(tmp_path):
    with pytest.raises(InputError, match=r": is a directory, expected a motion file \(.mcap\) or a folder of rosbag2$"):
        read_motion(tmp_path)
