import io

from rich.console import Console

from humanoid_sim.doctor.ranking import Ranking
from humanoid_sim.doctor.run import SearchProgress
from humanoid_sim.doctor.search import Plan


def lines(plan, *, terminal=False):
    stream = io.StringIO()
    ranking = Ranking()
    with SearchProgress(Console(file=stream, width=100, force_terminal=terminal), ranking, plan) as progress:
        for done in (0, 1, 2, 3):
            ranking.seconds = 1.0 + 6.0 * done
            progress("single changes", done, 3)
        progress("the best of them", 1, 1)
    return stream.getvalue().splitlines()


def test_where_there_is_no_terminal_every_stage_is_a_line_and_so_are_ten_seconds():
    assert lines(Plan((), (), 100, 60.0)) == [
        "single changes: 3; the search ends after 60 s (--budget)",
        "single changes: 2 of 3 tried, 13 s so far",
        "single changes: 3 tried, 19 s so far",
        "the best of them: 1 tried, 19 s so far",
    ]


def test_without_a_budget_none_is_named():
    assert lines(Plan((), (), 100))[0] == "single changes: 3"
