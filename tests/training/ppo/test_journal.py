import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.journal import Journal, Update, read_progress


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
    path.write_text(
        "steps,seconds,steps_per_second,return,episode_steps,failed,spread\n"
        "1000,60,100,1,50,1,0.4\n2000,120,100,2,60,1,0.4\n3000,180,100,3,70,1,0.4\n4000,2"
    )
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
        ("steps,seconds,steps_per_second,return,episode_steps,failed,spread\n1,2\n", "is not a training's progress"),
        (
            "steps,seconds,steps_per_second,return,episode_steps,failed,spread\n1,2,3,x,5,6,7\n",
            "is not a training's progress",
        ),
    ],
)
def test_another_file_is_refused(text, problem, tmp_path):
    path = tmp_path / "progress.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError) as error:
        read_progress(path)
    assert str(error.value).startswith(f"{path}: {problem}")
