"""The wheel holds everything as ordinary files, and works where the checkout is not."""

import os
import shutil
import subprocess
import sys
import venv
import zipfile
from glob import glob
from pathlib import Path

import pytest

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

ROOT = Path(__file__).parents[2]
LINKED = ("controllers", "envs", "hardware", "assets")
SUFFIXES = {".py", ".typed", ".yaml", ".xml", ".html", ".css", ".js", ".onnx", ".mcap", ".mid", ".msg"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built from a copy of the sources, with the setuptools of this environment: nothing is downloaded."""
    source = tmp_path_factory.mktemp("source")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("humanoid_sim", "tools", *LINKED):  # tools: to be left out
        shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir"]
    subprocess.run(
        [*command, str(folder), str(source)], check=True, capture_output=True, env={**os.environ, "PIP_NO_INDEX": "1"}
    )
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_holds_the_whole_package_as_ordinary_files_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        held = {info.filename: info for info in archive.infolist()}
        info = {Path(name).name: archive.read(name).decode() for name in held if ".dist-info/" in name}
    for entry in held.values():
        assert (entry.external_attr >> 28) in (0, 0o10), f"{entry.filename} is not an ordinary file"
    found = glob("humanoid_sim/**", root_dir=ROOT, recursive=True)  # which follows links
    sources = {name for name in found if Path(name).suffix in SUFFIXES and "__pycache__" not in name}
    assert {f"humanoid_sim/{package}/__init__.py" for package in LINKED} <= sources
    assert not sources - set(held)
    # nothing else
    assert {name.split("/")[0].partition("-")[0] for name in held} == {"humanoid_sim"}
    assert not [name for name in held if "tests/" in name or "notebook" in name or name.endswith((".pyc", ".ipynb"))]
    # what it says of itself
    assert "humanoid-sim = humanoid_sim.cli:main" in info["entry_points.txt"]
    assert "License-Expression: MIT" in info["METADATA"]
    assert "MIT License" in info["LICENSE"]


@pytest.fixture
def python(tmp_path):
    """Of a clean environment, which pytest would keep: half a gigabyte."""
    venv.create(tmp_path / "venv", with_pip=True)
    yield str(tmp_path / "venv" / "bin" / "python")
    shutil.rmtree(tmp_path / "venv")


def test_installed_in_a_clean_environment_it_plays_and_replays(wheel, python, tmp_path):
    work = tmp_path / "work"
    work.mkdir()

    def run(*arguments):
        environ = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "DISPLAY")}
        done = subprocess.run([python, *arguments], cwd=work, env=environ, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    constraints = str(ROOT / "constraints.txt")
    run("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-c", constraints, str(wheel))
    where = run("-c", "import humanoid_sim.controllers.supervisor as s; print(s.__file__)")
    assert "site-packages/humanoid_sim/controllers/supervisor.py" in where
    played = ("--duration", "7", "--viewer", "none", "--html", "none", "--record", "r.mcap")
    assert "LOCOMOTION" in run("-m", "humanoid_sim.play", *played)
    assert "bit for bit identical" in run("-m", "humanoid_sim.replay", "r.mcap")
