import io

from rich.console import Console

from humanoid_sim.regress.run import EpisodeProgress


def shown(label, steps, total):
    """The lines where nobody watches, of episodes that end at these times, s."""
    now, out = [0.0], io.StringIO()
    with EpisodeProgress(Console(file=out, width=200), label, total, lambda: now[0]) as progress:
        for time, count in steps:
            now[0] = time
            progress(count)
    return out.getvalue().splitlines()


def test_a_line_every_ten_seconds_says_how_long_it_will_take():
    steps = [(5.0, 2), (12.0, 4), (15.0, 2), (30.0, 4), (60.0, 12)]
    assert shown("baseline", steps, 24) == [
        "baseline: episodes 6 of 24, about 36 s left",
        "baseline: episodes 12 of 24, about 30 s left",
    ]


def test_a_short_run_and_a_quiet_one_say_nothing():
    assert shown("[v1]", [(5.0, 12), (9.9, 12)], 24) == []
    assert shown("", [(20.0, 12), (40.0, 12)], 24) == []
