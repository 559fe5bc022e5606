"""What `train` refuses, in one line, before anything is trained or written."""

import re
import shlex
import sys

import pytest
from refusals import refusals

from humanoid_sim.cli import run_program
from humanoid_sim.envs.tasks import TASKS
from humanoid_sim.training import main
from humanoid_sim.training.ppo.learner import ALGORITHMS
from humanoid_sim.training.ppo.run import seed_of


def refused(options, folder, monkeypatch, capsys):
    """The one line that is said of options, which leave nothing."""
    monkeypatch.chdir(folder)
    assert run_program(main, ["train", *options]) == 2
    (line,) = capsys.readouterr().err.splitlines(keepends=True)
    assert line.startswith("error: ")
    assert list(folder.iterdir()) == []
    return line


@pytest.mark.parametrize(("options", "message"), refusals(__file__))
def test_a_mistake_is_one_line_and_leaves_nothing(options, message, tmp_path, monkeypatch, capsys):
    assert message.strip("… ") in refused(shlex.split(options), tmp_path, monkeypatch, capsys)


def test_every_task_is_known(tmp_path, monkeypatch, capsys):
    known = f"known: auto, {', '.join(TASKS)}; or a class of your own, FILE.py:NAME or MODULE:NAME\n"
    line = refused(["--task", "dance"], tmp_path, monkeypatch, capsys)
    assert f"--task: unknown task 'dance'; {known}" in line


def test_a_bad_randomisation_names_its_file(tmp_path, capsys):
    file = tmp_path / "spread.yaml"
    file.write_text("weight: [0.9, 1.1]\n")
    assert run_program(main, ["train", "--randomisation", str(file)]) == 2
    assert f"{file}: randomisation: unknown field 'weight'; known: mass, " in capsys.readouterr().err


def test_a_training_that_goes_on_draws_other_numbers():
    assert seed_of(7, 0) == 7
    assert seed_of(7, 12) == seed_of(7, 12)
    assert len({seed_of(7, 0), seed_of(7, 12), seed_of(7, 13), seed_of(8, 12)}) == 4


def test_help_names_every_task_and_algorithm(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["train", "--help"])
    assert ended.value.code == 0
    words = re.findall(r"[\w-]+", re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out))
    assert {*TASKS, *ALGORITHMS} <= set(words)


@pytest.mark.parametrize(
    ("algorithm", "missing", "module"), [("ppo-sb3", "stable_baselines3", "sb3"), ("ppo-rsl_rl", "rsl_rl", "rsl")]
)
def test_a_missing_library_says_what_to_install(algorithm, missing, module, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name == missing or name.startswith(f"{missing}.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    for name in (
        f"humanoid_sim.training.ppo.{module}",
        "humanoid_sim.envs.stable_baselines",
        "humanoid_sim.envs.rsl_rl",
    ):
        monkeypatch.delitem(sys.modules, name, raising=False)
    assert run_program(main, ["train", "--algorithm", algorithm]) == 2
    assert "pip install 'humanoid_sim[rl]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
