"""Checkpoints of W&B runs, by a stand-in for the part of the `wandb` package that is used."""

import sys
import types
from dataclasses import dataclass
from pathlib import Path

import pytest
from motion_samples import POLICY, joint_path, lite, state_of, write_npz

from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.prepare import main
from humanoid_sim.prepare.wandb_run import fetch_checkpoint

RUN = "lab/arms/7xk2"


@dataclass
class File:
    name: str

    def download(self, root, replace):
        assert replace
        path = Path(root) / self.name
        path.write_bytes(POLICY.read_bytes())
        return path.open()


@pytest.fixture
def service(monkeypatch):
    """The names of each run's files."""
    answer = {}

    def run(path):
        return types.SimpleNamespace(files=lambda: [File(name) for name in answer[path]])

    module = types.ModuleType("wandb")
    module.Api = lambda **_: types.SimpleNamespace(run=run)
    monkeypatch.setitem(sys.modules, "wandb", module)
    return answer


def test_the_newest_model_by_its_number_with_its_tensors(service, tmp_path):
    service[RUN] = ["config.yaml", "model_900.onnx", "model_1500.onnx", "model_1500.onnx.data", "other_9999.onnx"]
    assert fetch_checkpoint(RUN, None, tmp_path) == tmp_path / "model_1500.onnx"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model_1500.onnx", "model_1500.onnx.data"]
    assert fetch_checkpoint(RUN, "model_900.onnx", tmp_path).is_file()


@pytest.mark.parametrize(
    ("files", "run", "name", "reason"),
    [
        (["model_3.pt"], RUN, None, r"--wandb-file: is missing, .*: model_3\.pt"),
        (["../a.onnx"], RUN, None, r"is \.\./a\.onnx, expected a checkpoint of run"),
        (["a.onnx"], RUN, "c.onnx", r"is c\.onnx, .*: a\.onnx"),
        ([], "lab/arms/none", None, "run lab/arms/none cannot be read"),
    ],
)
def test_a_run_without_the_checkpoint(service, tmp_path, files, run, name, reason):
    service[RUN] = files
    with pytest.raises(InputError, match=reason):
        fetch_checkpoint(run, name, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_motion_for_a_run_s_checkpoint(service, tmp_path):
    service[RUN] = ["model_300.onnx"]
    bodies = ("chest", *lite().hands)
    motion = write_npz(tmp_path / "dance.npz", state_of(joint_path(), bodies))
    given = ["--wandb-run-path", RUN, "--motion", str(motion), "--output", str(tmp_path / "out")]
    (tmp_path / "out").mkdir()
    assert run_program(main, [*given, "--body-order", ",".join(bodies)]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["dance.mcap", "model_300.onnx"]
