import io
import json

import pytest
from PIL import Image

from humanoid_sim.cli import run_program
from humanoid_sim.training import main

HEADER = "steps,seconds,steps_per_second,return,episode_steps,failed,spread\n"


def write_run(folder, algorithm, robot="lite", rows=""):
    folder.mkdir()
    run = {"robot": robot, "task": "tracking", "algorithm": algorithm, "robots": 64}
    (folder / "run.json").write_text(json.dumps(run))
    (folder / "progress.csv").write_text(HEADER + rows)
    return folder


ROWS = "2000,1,2000,nan,nan,nan,0.4\n1000000,300,3000,1.5,50,1,0.4\n2000000,630,3000,9.75,400,0,0.3\n"


@pytest.fixture(scope="module")
def fonts():
    """matplotlib opens its fonts with the first text that it draws, and keeps them open."""
    figure = pytest.importorskip("matplotlib.figure").Figure()
    figure.subplots().set(title="text")
    figure.savefig(io.BytesIO(), format="png")


@pytest.mark.usefixtures("fonts")
def test_runs_become_a_picture_and_lines(tmp_path, capsys):
    runs = [
        write_run(tmp_path / "a", "ppo-sb3", rows=ROWS),
        write_run(tmp_path / "b", "ppo-rsl_rl", rows=ROWS),
        write_run(tmp_path / "c", "ppo-sb3", robot="lite_biped", rows=ROWS),
    ]
    picture = tmp_path / "curves.png"
    assert main(["curves", *map(str, runs), "--output", str(picture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "lite, tracking, stable-baselines3, 64 robots: return 1.50 to 9.75 in 2.00 M steps, 10.5 min"
    assert lines[1].startswith("lite, tracking, rsl_rl, 64 robots: ")
    assert lines[2].startswith("lite_biped, tracking, stable-baselines3")
    with Image.open(picture) as image:
        assert image.size == (990, 704)  # two rows of diagrams
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 20) or ()}
    assert {(31, 119, 180), (255, 127, 14)} <= colours  # two curves


@pytest.mark.parametrize(
    ("rows", "run", "problem"),
    [
        ("", None, "no episode has ended yet, expected a longer run"),
        ("2000,1,2000,nan,nan,nan,0.4\n", None, "no episode has ended yet"),
        (ROWS, "{}", "is not a folder of `train`: run.json cannot be read"),
        (ROWS, "[", "is not a folder of `train`: run.json cannot be read"),
    ],
)
def test_other_folders_are_refused(rows, run, problem, tmp_path, capsys):
    folder = write_run(tmp_path / "a", "ppo-sb3", rows=rows)
    if run is not None:
        (folder / "run.json").write_text(run)
    picture = tmp_path / "curves.png"
    assert run_program(main, ["curves", str(folder), "--output", str(picture)]) == 2
    assert problem in capsys.readouterr().err
    assert not picture.exists()


def test_the_picture_is_a_png(tmp_path, capsys):
    assert run_program(main, ["curves", str(tmp_path), "--output", str(tmp_path / "a.jpg")]) == 2
    assert "expected a name that ends in .png" in capsys.readouterr().err
