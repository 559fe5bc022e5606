"""Completion in a real bash."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from humanoid_sim.cli import main

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "humanoid-sim"
    with pytest.MonkeyPatch.context() as patch, path.open("w") as file:
        patch.setattr("sys.stdout", file)
        assert main(["--completion", "bash"]) == 0
    return path


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("re", ["replay", "record", "record_dataset", "regress", "rerun"]),
        ("play --vi", ["--viewer", "--video"]),
        ("play --viewer n", ["none", "native"]),
        ("play --robot lite_bi", ["lite_biped"]),
        ("play --yaw 3 --motion w", ["wave"]),
        ("regress --suite v", ["velocity"]),
        ("hardware param s", ["set", "save"]),
        ("hardware param get --h", ["--host-id", "--help"]),
        ("policy doctor --pa", ["--pairs"]),
        ("mode start", ["start_locomotion", "start_remote"]),
        ("ros2_services --", ["--help"]),
        ("play x", []),
    ],
)
def test_what_the_tab_key_offers(script: Path, typed: str, offered: list[str]) -> None:
    words = ["humanoid-sim", *typed.split(" ")]
    line = " ".join(shlex.quote(word) for word in words)
    code = f"source {script}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _humanoid_sim; echo ${{COMPREPLY[@]}}"
    run = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True)
    assert (run.stdout.split(), run.stderr) == (offered, "")


def test_other_shells_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion", "tcsh"]) == 2
    assert capsys.readouterr().err == "error: --completion: is 'tcsh', expected bash\n"
