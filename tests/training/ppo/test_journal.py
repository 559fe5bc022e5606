"""The journal of a training: figures of the episodes, rows, lines and curves."""

import io
import json

import gymnasium
import numpy as np
import pytest
from PIL import Image

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.training import main
from humanoid_sim.training.ppo.journal import EpisodeMeter, Journal, Update, read_progress

HEADER = "steps,seconds,steps_per_second,return,episode_steps,failed,spread\n"


class Meter:
    """Figures of episodes that never change."""

    def means(self):
        return 7.25, 120.0, 0.25

    def terms(self):
        return {"alive": 0.01}


METER = Meter()


def test_each_update_is_a_row_and_the_last_is_told(tmp_path):
    lines = []
    journal = Journal(tmp_path, 2000, METER, lines.append, tensorboard=False)
    for steps in (1000, 2000):
        journal.record(Update(steps, 0.4, {"value": 0.1}))
    rows = read_progress(tmp_path / "progress.csv")
    assert [row["steps"] for row in rows] == [1000.0, 2000.0]
    assert [row["return"] for row in rows] == [7.25, 7.25]
    assert rows[0]["seconds"] < rows[1]["seconds"]
    (line,) = lines
    assert line.startswith("0.0020 of 0.0020 M steps, ")
    assert line.endswith("return 7.25, episodes of 120 steps, 25 % failed, 0 min left")


def test_the_time_left_ends_with_the_minutes(tmp_path):
    row = {"steps": 1000.0, "seconds": 30.0, "steps_per_second": 1.0}
    row |= {"return": 1.0, "episode_steps": 2.0, "failed": 0.0}
    for steps, limit, left in ((2_000_000, 630.0, "10 min"), (1120, 630.0, "2 min"), (1120, 20.0, "0 min")):
        journal = Journal(tmp_path, steps, METER, print, limit=limit, tensorboard=False)
        assert journal.line(row).endswith(f", {left} left")
    unlimited = Journal(tmp_path, 11_800, METER, print, tensorboard=False)
    assert unlimited.line(row).endswith("3.0 h left")


def test_what_a_checkpoint_does_not_know_is_dropped(tmp_path):
    path = tmp_path / "progress.csv"
    path.write_text(f"{HEADER}1000,60,100,1,50,1,0.4\n2000,120,100,2,60,1,0.4\n3000,180,100,3,70,1,0.4\n4000,2")
    assert len(read_progress(path)) == 3  # the last line was not finished
    journal = Journal(tmp_path, 5000, METER, print, done=2000, tensorboard=False)
    assert 120.0 <= journal.seconds < 180.0
    journal.record(Update(3000, 0.3))
    rows = read_progress(path)
    assert [row["steps"] for row in rows] == [1000.0, 2000.0, 3000.0]
    assert [row["return"] for row in rows] == [1.0, 2.0, 7.25]
    assert rows[2]["seconds"] >= 120.0


def test_a_new_run_drops_all_rows(tmp_path):
    Journal(tmp_path, 10, METER, print, tensorboard=False).record(Update(5, 0.3))
    Journal(tmp_path, 10, METER, print, tensorboard=False)
    assert read_progress(tmp_path / "progress.csv") == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (None, "no such file, expected progress.csv of a training"),
        ("", "is not a training's progress, expected the columns steps, seconds, "),
        ("a,b\n1,2\n", "is not a training's progress"),
        (f"{HEADER}1,2\n", "is not a training's progress"),
        (f"{HEADER}1,2,3,x,5,6,7\n", "is not a training's progress"),
    ],
)
def test_another_file_is_refused(text, problem, tmp_path):
    path = tmp_path / "progress.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError) as error:
        read_progress(path)
    assert str(error.value).startswith(f"{path}: {problem}")


def test_returns_and_lengths_are_those_of_the_episodes():
    meter = EpisodeMeter(
        gymnasium.make_vec(
            "humanoid_sim/LiteTracking-v0", num_envs=3, threads=1, autoreset_mode="SameStep", max_episode_steps=4
        )
    )
    meter.reset(seed=0)
    assert np.isnan(meter.means()).all()
    rewards = []
    for step in range(5):
        action = np.zeros((3, 14), dtype=np.float32)
        if step == 1:
            action[2] = np.nan  # a fault ends the third episode with its second step, without a reward
        _, reward, terminated, truncated, info = meter.step(action)
        rewards.append(reward)
        assert (terminated | truncated).tolist() == {1: [False, False, True], 3: [True, True, False]}.get(
            step, [False] * 3
        )
    expected = np.array([*np.sum(rewards[:4], axis=0)[:2], rewards[0][2]])
    assert meter.means() == pytest.approx((expected.mean(), (4 + 4 + 2) / 3, 1 / 3))
    assert set(meter.terms()) >= {"body_position", "action_rate"}
    assert meter.terms()["body_position"] == pytest.approx(float(info["terms"]["body_position"].mean()))
    meter.close()


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


def test_a_resumed_training_waits_for_its_long_episodes():
    name = "humanoid_sim/LiteTracking-v0"
    envs = gymnasium.make_vec(name, num_envs=2, threads=1, autoreset_mode="SameStep", max_episode_steps=4)
    meter = EpisodeMeter(envs, resumed=True)
    meter.reset(seed=0)
    action = np.zeros((2, 14), dtype=np.float32)
    meter.step(np.array([action[0], np.full(14, np.nan, dtype=np.float32)]))  # the second robot fails at once
    assert np.isnan(meter.means()).all()
    for _ in range(3):
        meter.step(action)
    assert meter.means()[1:] == (2.5, 0.5)
    meter.close()
