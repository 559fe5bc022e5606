"""The documented bounds are the ones in force."""

import re
from pathlib import Path

import pytest

from humanoid_sim import bounds

ROOT = Path(__file__).parents[1]
GUIDE = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
ROWS = {row.split("|")[1].strip(): row for row in GUIDE.splitlines() if row.startswith("| ")}


def amount(number):
    for size, unit in ((1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")):
        if number % size == 0 and number // size <= 1024:
            return f"{number // size} {unit}"
    return f"{number:_}".replace("_", " ") if number >= 10_000 else str(number)


@pytest.mark.parametrize(
    ("row", "names"),
    [
        ("robot `.yaml`", ("YAML_BYTES", "YAML_VALUES", "YAML_TEXT")),
        ("checkpoint `.onnx`, and `.onnx.data` beside it", ("ONNX_BYTES",)),
        ("MJCF `.xml` and what it includes", ("MJCF_BYTES", "MJCF_ELEMENTS", "MJCF_SIZE", "MJCF_MEMORY")),
        ("motion `.mcap`, also inside a recording", ("MOTION_VALUES",)),
        ("recording `.mcap`", ("MCAP_CHUNK_BYTES", "MCAP_RECORD_BYTES")),
        ("its header", ("OBSERVATION_WIDTH",)),
        ("motion `.npz`, trace `.npz`", ("NPZ_BYTES", "NPZ_ARRAYS")),
        ("motion `.csv`", ("CSV_BYTES",)),
        ("baseline `.json`", ("JSON_BYTES",)),
    ],
)
def test_the_table_has_the_bounds(row, names):
    for name in names:
        assert re.search(rf"(?<!\d){amount(getattr(bounds, name))}(?!\d)", ROWS[row]), name


def test_every_reader_of_the_table_exists():
    files = re.findall(r"`([a-z_0-9]+/[a-z_0-9/]+\.py)`", GUIDE)
    assert len(files) > 15
    assert [file for file in files if not (ROOT / file).is_file()] == []
