"""Datasets of LeRobot's format v3.0, as its writer lays out their files."""

import json
import sys
import types

import numpy as np
import pyarrow as pa
import pytest
from motion_samples import BODIES, joint_frames, joint_path, lite, prepare, refusal, state_of
from pyarrow import parquet

from humanoid_sim.policy.motion import read_motion
from humanoid_sim.prepare.sources import dataset_folder

ORDER = np.random.default_rng(2).permutation(14)
Q = joint_path()
FRAMES = joint_frames(lite(), Q)
WORLD = state_of(Q, ("chest", *BODIES))
NAMES = {
    "observation.state": {"motors": [f"{lite().joint_names[i]}.pos" for i in ORDER]},
    "qpos.state": {"motors": [f"{name}.pos" for name in lite().joint_names[:13]]},
    "body_pos_w": [f"{body}.{axis}" for body in ("chest", *BODIES) for axis in "xyz"],
}
JOINTS = {"observation.state": Q[:, ORDER]}
IN_WORLD = {name: WORLD[name].reshape(len(Q), -1) for name in ("body_pos_w", "body_quat_w")}
IN_BASE = {"motion_body_pos_b": FRAMES[:, :12], "motion_body_ori_b": FRAMES[:, 12:]}


def write(root, *episodes, fps=50, version="v3.0"):
    """Files as `lerobot` 0.4 writes them: one of all episodes' frames, one of the episodes, and what they hold."""
    rows, listed = {}, []
    for index, columns in enumerate(episodes):
        length = len(next(iter(columns.values())))
        own = {"timestamp": np.arange(length, dtype=np.float32) / fps, "frame_index": np.arange(length)}
        for key, values in {**columns, **own, "episode_index": np.full(length, index)}.items():
            rows.setdefault(key, []).extend(values.tolist())
        listed.append({"episode_index": index, "length": length, "data/chunk_index": 0, "data/file_index": 0})
    features = {
        key: {"dtype": "float32", "shape": values[0].shape, "names": NAMES.get(key)}
        for key, values in episodes[0].items()
    }
    features |= {key: {"dtype": "int64", "shape": [1], "names": None} for key in ("frame_index", "episode_index")}
    features |= {"timestamp": {"dtype": "float32", "shape": [1], "names": None}, "image": {"dtype": "video"}}
    path = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    for folder in ("data/chunk-000", "meta/episodes/chunk-000"):
        (root / folder).mkdir(parents=True)
    info = {"codebase_version": version, "fps": fps, "features": features, "data_path": path}
    (root / "meta" / "info.json").write_text(json.dumps(info))
    parquet.write_table(pa.table(rows), root / "data" / "chunk-000" / "file-000.parquet")
    parquet.write_table(pa.Table.from_pylist(listed), root / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    return root


METHODS = [(JOINTS | IN_WORLD, "forward"), (IN_BASE, "inverse"), (JOINTS, "note: without body poses")]


@pytest.mark.parametrize(("columns", "method"), METHODS)
def test_an_episode_becomes_a_motion(tmp_path, capsys, columns, method):
    root = write(tmp_path / "dances", {key: values[::-1] for key, values in columns.items()}, columns)
    assert prepare(tmp_path, root, "--episode", "1") == 0
    assert method in capsys.readouterr().out
    np.testing.assert_allclose(read_motion(tmp_path / "out" / "dances_1.mcap").frames, FRAMES, atol=2e-6)


@pytest.mark.parametrize(
    ("columns", "options", "reason"),
    [
        ({"qpos.state": Q[:, :13]}, [], f"lacks {lite().joint_names[13]}"),
        ({"measured": Q}, [], "holds no motion"),
        (JOINTS | {"body_pos_w": IN_WORLD["body_pos_w"]}, [], "expected both"),
        (JOINTS, ["--episode", "1"], "--episode: is 1, expected one of the 1 episodes"),
    ],
)
def test_what_is_missing_or_ambiguous_is_named(tmp_path, capsys, columns, options, reason):
    assert reason in refusal(capsys, tmp_path, write(tmp_path / "dances", columns), *options)


@pytest.mark.parametrize(
    ("place", "named"),
    [("lerobot/scripts", "python -m lerobot.scripts.convert_dataset_v21_to_v30"), ("other", "LeRobot's convert_")],
)
def test_an_older_dataset_names_the_converter_of_the_lerobot_that_is_there(tmp_path, capsys, monkeypatch, place, named):
    (tmp_path / place).mkdir(parents=True)
    (tmp_path / "lerobot").mkdir(exist_ok=True)
    (tmp_path / "lerobot" / "__init__.py").touch()
    (tmp_path / place / "convert_dataset_v21_to_v30.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    older = refusal(capsys, tmp_path, write(tmp_path / "older", JOINTS, version="v2.1"))
    assert f"format v2.1, expected v3.0; convert it with {named}" in older


def test_a_dataset_of_the_hub(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "home"))
    kept = write(tmp_path / "home" / "lab" / "kept", IN_BASE)
    assert dataset_folder("lab/kept") == kept
    hub = types.ModuleType("huggingface_hub")
    fetched = write(tmp_path / "hub", IN_BASE)
    hub.snapshot_download = lambda name, **_: {"lab/dances": str(fetched)}[name]
    monkeypatch.setitem(sys.modules, "huggingface_hub", hub)
    assert prepare(tmp_path, "lab/dances") == 0
    np.testing.assert_allclose(read_motion(tmp_path / "out" / "dances_0.mcap").frames, FRAMES, atol=2e-6)
    assert "'lab/gone' cannot be fetched from the hub" in refusal(capsys, tmp_path, "lab/gone")
