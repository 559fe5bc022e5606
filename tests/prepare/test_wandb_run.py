import sys

import pytest
from fake_wandb import Artifact, CommError, File, Service

from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.prepare.wandb_run import cache_folder, fetch_checkpoint

RUN = "lab/arms/7xk2"


@pytest.fixture
def service(monkeypatch, tmp_path):
    service = Service()
    monkeypatch.setitem(sys.modules, "wandb", service.module())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    yield service
    service.released.set()


def fetch(name=None, timeout=5.0, **options):
    return fetch_checkpoint(RUN, name, timeout=timeout, **options)[0]


def test_the_newest_model_by_its_number(service):
    service.add(RUN, "config.yaml", "model_900.onnx", "model_1500.onnx", "model_1500.pt", "other_9999.onnx")
    path = fetch()
    assert path == cache_folder() / RUN / "model_1500.onnx"
    assert path.read_bytes() == b"model model_1500.onnx" * 10
    assert service.downloads == ["model_1500.onnx"]
    assert [file.name for file in path.parent.iterdir()] == ["model_1500.onnx"]


def test_a_file_by_name_and_its_external_tensors(service):
    service.add(RUN, "exported/policy.onnx", "exported/policy.onnx.data", "model_3.onnx")
    path = fetch("exported/policy.onnx")
    assert path == cache_folder() / RUN / "exported" / "policy.onnx"
    assert path.with_name("policy.onnx.data").is_file()


def test_what_is_in_the_cache_is_not_fetched_again(service):
    run = service.add(RUN, "model_3.onnx")
    fetch()
    fetch()
    assert service.downloads == ["model_3.onnx"]
    run.inside[0].data = b"trained on"
    assert fetch().read_bytes() == b"trained on"
    assert service.downloads == ["model_3.onnx"] * 2


def test_a_run_whose_checkpoint_is_an_artifact(service):
    run = service.add(RUN, "config.yaml")
    older, newer = (File(f"model_{number}.onnx", b"weights", service) for number in (100, 50))
    run.artifacts = [Artifact([older]), Artifact([newer]), Artifact([File("table.json", b"{}", service)])]
    assert fetch().name == "model_50.onnx"  # the newest artifact's, whatever its number


@pytest.mark.parametrize(
    ("files", "name", "reason"),
    [
        (["model_3.pt"], None, r"has no \.onnx file \(export the checkpoint\); it has: model_3\.pt"),
        (["a.onnx", "b.onnx"], None, r"has several \.onnx files; choose with --wandb-file: a\.onnx, b\.onnx"),
        (["../a.onnx"], None, r"has a file '\.\./a\.onnx', expected a name inside a folder"),
        (["/a.onnx"], None, r"has a file '/a\.onnx', expected a name inside a folder"),
        (["a.onnx"], "c.onnx", r"--wandb-file: run lab/arms/7xk2 has no 'c\.onnx'; it has: a\.onnx"),
    ],
)
def test_a_run_without_the_checkpoint(service, files, name, reason):
    service.add(RUN, *files)
    with pytest.raises(InputError, match=reason):
        fetch(name)


def test_a_run_that_does_not_exist(service):
    with pytest.raises(InputError, match="--wandb-run-path: Could not find run"):
        fetch()


@pytest.mark.parametrize("path", ["run", "lab/run", "lab/arms/7xk2/more", "lab//x", "lab/my project/x"])
def test_a_path_that_is_none(service, path):
    with pytest.raises(InputError, match="expected entity/project/run"):
        fetch_checkpoint(path, None, timeout=1.0)


def test_no_answer_is_no_hang(service):
    service.hangs = True
    with pytest.raises(InputError, match=r"run lab/arms/7xk2 cannot be reached: no answer within 0\.2 s"):
        fetch(timeout=0.2)


def test_a_download_that_is_torn(service):
    service.add(RUN, "model_3.onnx").inside[0].torn = True
    with pytest.raises(InputError, match=r"'model_3\.onnx' of run lab/arms/7xk2 arrived incomplete"):
        fetch()
    assert list((cache_folder() / RUN).iterdir()) == []


def test_offline(service):
    service.add(RUN, "model_3.onnx", "model_4.onnx")
    fetch("model_3.onnx")
    service.fails = ConnectionError("name resolution")
    with pytest.raises(
        InputError, match=r"no connection; fetched before: model_3\.onnx \(choose one with --wandb-file\)"
    ):
        fetch()
    path, notice = fetch_checkpoint(RUN, "model_3.onnx", timeout=1.0)
    assert path.is_file()
    assert "no connection; model_3.onnx is the copy in" in notice


def test_offline_inside_the_package_s_own_error(service):
    service.fails = CommError("Network error")
    service.fails.__cause__ = ConnectionError()
    with pytest.raises(InputError, match="cannot be reached: no connection; --policy takes a file"):
        fetch()


def test_without_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(
        MissingPackageError, match=r"'wandb', which is not installed: pip install 'humanoid_sim\[wandb\]'"
    ):
        fetch()
