"""Completion in real shells."""

import re
import shlex
import shutil
import subprocess

import pytest

from humanoid_sim.cli import main
from humanoid_sim.command_line.completion import SHELLS

OFFERED = [
    ("re", ["replay", "record", "regress", "rerun"]),
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
BASH = """
source {folder}/bash; COMP_WORDS=(humanoid-sim {line}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
_shtab_humanoid_sim; echo ${{COMPREPLY[@]}}
"""
ZSH = """
zmodload zsh/zpty
zpty shell ZDOTDIR={folder} zsh -i
zpty -r -m shell before '*READY>*'
zpty -w -n shell 'humanoid-sim {line}'$'\\t\\x15'"print DO''NE"$'\\n'
zpty -r -m shell shown '*DONE*'
print -r -- $shown
"""
RC = """
PROMPT='READY>'; fpath=({folder} $fpath); autoload -U compinit; compinit -u -D
setopt noautomenu noalwayslastprompt; bindkey '^I' list-choices
"""


@pytest.fixture(scope="module")
def scripts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("completion")
    for shell, name in (("bash", "bash"), ("zsh", "_humanoid_sim")):
        with pytest.MonkeyPatch.context() as patch, (folder / name).open("w") as file:
            patch.setattr("sys.stdout", file)
            assert main(["--completion", shell]) == 0
    (folder / ".zshrc").write_text(RC.format(folder=folder))
    return folder


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(("typed", "offered"), OFFERED)
def test_what_the_tab_key_offers(scripts, shell, typed, offered, tmp_path):
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    code = {"bash": BASH, "zsh": ZSH}[shell].format(folder=shlex.quote(str(scripts)), line=typed)
    options = {"bash": (), "zsh": ("-f",)}[shell]
    run = subprocess.run([shell, *options, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert run.stderr == ""
    found = run.stdout.split()
    if shell == "zsh":
        plain = re.sub(r"\x1b\[\??[0-9]*[A-Za-z]|\r", "", run.stdout).splitlines()
        listed = [line.partition(" -- ")[0] for line in plain if "humanoid-sim" not in line and "DONE" not in line]
        found = " ".join(listed).split()
    assert sorted(found) == sorted(offered)


def test_other_shells_are_refused(capsys):
    assert main(["--completion", "tcsh"]) == 2
    assert capsys.readouterr().err == "error: --completion: unknown shell 'tcsh'; known: bash, zsh\n"
    assert main(["--completion", "bsah"]) == 2
    assert "unknown shell 'bsah' (did you mean 'bash'?)" in capsys.readouterr().err
