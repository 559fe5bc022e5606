"""Bounds for files from outside, by kind: on their size, and on what they unpack to. The one table for all readers.

A robot's computer does not read more than any robot, policy or motion needs: a file that claims more is refused by its
first bytes, before memory is allocated. `docs/files.md` has the table, with the reader of each kind.
"""

from __future__ import annotations

_KIB, _MIB, _GIB = 1 << 10, 1 << 20, 1 << 30

YAML_BYTES = _MIB
"""Bytes of a YAML file: robots, contracts, `deploy.yaml`, suites, calibrations. The largest shipped one has 6 KiB."""
YAML_VALUES = 100_000
"""Values of a YAML document, those that its aliases repeat counted each time."""
YAML_TEXT = 64 * _KIB
"""Characters of one text in it."""
JSON_BYTES = 64 * _MIB
"""Bytes of a JSON file: baselines of `regress`, a dataset's `info.json`."""
CSV_BYTES = 64 * _MIB
"""Bytes of a motion in a `.csv`: 3 MB are three minutes of a robot with 29 joints."""
ONNX_BYTES = _GIB
"""Bytes of a checkpoint, and of the file beside it that holds its tensors."""
ONNX_SECONDS = 10.0
"""s of one inference of a model whose graph can loop; on hardware much less, see `play`."""
MOTION_SECONDS = 300.0
"""s in which a motion is read out of a model's graph: half an hour of it takes some seconds."""
NPZ_BYTES = _GIB
"""Bytes of all arrays of an `.npz` together, unpacked."""
NPZ_ARRAYS = 1000
"""Arrays of an `.npz`."""
MOTION_VALUES = 50_000_000
"""Values of all frames of a motion: half an hour at 50 Hz is 90 000 frames."""
MCAP_CHUNK_BYTES = 64 * _MIB
"""Bytes of one chunk of an MCAP file, unpacked. Those of a recording hold half a second, about 100 kB."""
MCAP_RECORD_BYTES = 256 * _MIB
"""Bytes of any record of an MCAP file outside of chunks, attachments among them."""
MIDI_BYTES = 512 * _KIB
"""Bytes of a song: an hour of two hands has 200 kB."""
SONG_SECONDS = 3600.0
"""s of a song: the goals of all keys in each step of a fast policy are 250 MB."""
OBSERVATION_WIDTH = 1_000_000
"""Values of one observation that a recording may declare."""
MJCF_BYTES = 16 * _MIB
"""Bytes of an MJCF file, and of each that it includes."""
MJCF_ELEMENTS = 100_000
"""Elements of an MJCF with its includes, those that `replicate`, `composite` and `flexcomp` make counted each time."""
MJCF_SIZE = 16_000_000
"""Values of a height field, pixels of a texture, and any other size that an MJCF gives as a number."""
MESH_BYTES = 32 * _MIB
"""Bytes of a mesh that an MJCF names. The largest `.stl` that MuJoCo takes, 200 000 faces, has 10 MB."""
PICTURE_BYTES = 64 * _MIB
"""Bytes of a picture that an MJCF names; its pixels are bounded by `MJCF_SIZE`."""
MJCF_FILES_BYTES = 512 * _MIB
"""Bytes of all meshes and pictures of an MJCF together."""
MJCF_MEMORY = _GIB
"""Bytes of `<size memory>`."""
