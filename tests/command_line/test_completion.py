"""Completion in real shells."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from humanoid_sim.cli import main
from humanoid_sim.command_line.completion import SHELLS

OFFERED = [
    ("re", ["replay", "record", "record_dataset", "regress", "rerun"]),
    ("play --vi", ["--viewer", "--video"]),
    ("play --viewer n", ["none", "native"]),
    ("play --robot lite_bi", ["lite_biped"]),
    ("play --yaw 3 --motion w", ["wave"]),
    ("play --policy lite_p", ["lite_piano"]),
    ("policy show lite_b", ["lite_biped_velocity"]),
    ("regress --suite v", ["velocity"]),
    ("hardware param s", ["set", "save"]),
    ("hardware param get --h", ["--host-id", "--help"]),
    ("policy doctor --pa", ["--pairs"]),
    ("mode start", ["start_locomotion", "start_remote"]),
    ("ros2_services --", ["--help"]),
    ("--completion z", ["zsh"]),
    ("play 7", []),
]
STUBS = """
compdef() {{ }}
_files() {{ }}
compadd() {{ shift; local word=${{words[CURRENT]}}; print -l -- ${{(M)@:#$word*}} }}
source {script}
words=({line}); CURRENT={last}; _humanoid_sim
"""
"""What zsh has inside its line editor only."""


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("completion")
    for shell in SHELLS:
        with pytest.MonkeyPatch.context() as patch, (folder / shell).open("w") as file:
            patch.setattr("sys.stdout", file)
            assert main(["--completion", shell]) == 0
    return {shell: folder / shell for shell in SHELLS}


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(("typed", "offered"), OFFERED)
def test_what_the_tab_key_offers(
    scripts: dict[str, Path], shell: str, typed: str, offered: list[str], tmp_path: Path
) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    words = ["humanoid-sim", *typed.split(" ")]
    line, script = " ".join(shlex.quote(word) for word in words), scripts[shell]
    code = {
        "bash": f"source {script}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _humanoid_sim; "
        "echo ${COMPREPLY[@]}",
        "zsh": STUBS.format(script=script, line=line, last=len(words)),
        "fish": f"source {script}; complete -C {shlex.quote(line)}",
    }[shell]
    options = {"bash": (), "zsh": ("-f",), "fish": ("--no-config",)}[shell]
    run = subprocess.run([shell, *options, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert run.stderr == ""
    found = run.stdout.split()
    assert sorted(found) == sorted(offered)
    assert found == offered or shell == "fish", "fish sorts"


def test_other_shells_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion", "tcsh"]) == 2
    assert capsys.readouterr().err == "error: --completion: unknown shell 'tcsh'; known: bash, zsh, fish\n"
    assert main(["--completion", "bsah"]) == 2
    assert "unknown shell 'bsah' (did you mean 'bash'?)" in capsys.readouterr().err
