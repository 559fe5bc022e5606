"""Bags of rosbag2: a folder with `metadata.yaml` and files of storage `mcap` or `sqlite3`, as records of MCAP."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

from mcap.records import Channel, Schema

from humanoid_sim.errors import InputError
from humanoid_sim.files import regular_file
from humanoid_sim.ros2.mcap_stream import McapStream, Message, Record
from humanoid_sim.strict_yaml import read_yaml

__all__ = ["bag_streams", "is_bag"]

_METADATA = "metadata.yaml"
_STORAGES = ("mcap", "sqlite3")


def is_bag(path: Path) -> bool:
    """Return whether a path is a folder that rosbag2 has written."""
    return (path / _METADATA).is_file()


def bag_streams(folder: Path) -> Iterator[tuple[Path, McapStream | Database]]:
    """Yield each of a bag's files, in order, with its records.

    Raises:
        InputError: naming the bag and what of it cannot be read.
    """
    place = folder / _METADATA
    document = read_yaml(place)
    information = document.get("rosbag2_bagfile_information") if isinstance(document, dict) else None
    if not isinstance(information, dict):
        raise InputError(f"{place}: has no rosbag2_bagfile_information, expected the metadata of a rosbag2 bag")
    storage, names = information.get("storage_identifier"), information.get("relative_file_paths")
    if storage not in _STORAGES:
        raise InputError(f"{place}: storage_identifier: is {storage!r}, expected one of {', '.join(_STORAGES)}")
    if information.get("compression_mode") and information["compression_mode"].upper() != "NONE":
        mode = information["compression_mode"]
        raise InputError(f"{place}: compression_mode: is {mode!r}, expected a bag that is not compressed as a whole")
    if not (isinstance(names, list) and names and all(isinstance(name, str) for name in names)):
        raise InputError(f"{place}: relative_file_paths: is {names!r}, expected the names of the bag's files")
    for name in names:
        # Older versions of rosbag2 repeat the folder's name.
        file = regular_file(folder / Path(name).name, "a file of the bag")
        if storage == "sqlite3":
            yield file, Database(file)
        else:
            with file.open("rb") as opened:
                yield file, McapStream(opened)


class Database:
    """Iterates once over the messages of a bag's SQLite file."""

    def __init__(self, path: Path) -> None:
        """Prepare to read."""
        self._path = path
        self.damage = ""
        """Reason why reading ended early; empty for a sound file."""

    def __iter__(self) -> Iterator[Record]:
        uri = f"file:{quote(str(self._path.resolve()))}?mode=ro&immutable=1"
        try:
            with closing(sqlite3.connect(uri, uri=True)) as database:
                for number, name, kind, encoding in database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                ):
                    yield Schema(number, b"", "ros2msg", kind)
                    yield Channel(number, name, encoding, {}, number)
                rows: Any = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id")
                for index, (channel, time, data) in enumerate(rows):
                    yield Message(channel, index, time, time, data)
        except (sqlite3.Error, TypeError) as error:
            self.damage = f"not a database of rosbag2: {error}"
