"""Encodes this package's types as the ROS 2 messages of `schemas`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.recording.cdr import CdrError, CdrReader, CdrWriter

__all__ = ["decode_float32_array", "encode_float32_array"]


def encode_float32_array(values: npt.NDArray[np.float32]) -> bytes:
    """A `std_msgs/msg/Float32MultiArray` in CDR: the values, no dimensions."""
    writer = CdrWriter()
    writer.pack("II", 0, 0)
    writer.array(np.asarray(values, dtype=np.float32))
    return writer.message()


def decode_float32_array(message: bytes) -> npt.NDArray[np.float32]:
    """The flat values of a `std_msgs/msg/Float32MultiArray`. Shape (count,). Raises `CdrError`."""
    reader = CdrReader(message)
    for _ in range(reader.count(13)):
        reader.string()
        reader.unpack("II")
    (offset,) = reader.unpack("I")
    values: npt.NDArray[np.float32] = reader.array(np.float32)
    reader.finish()
    if offset > len(values):
        raise CdrError(f"data_offset {offset} in an array of {len(values)}")
    return values[offset:]
