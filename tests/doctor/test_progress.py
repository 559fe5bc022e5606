import io

from rich.console import Console

from humanoid_sim.doctor.ranking import Ranking
from humanoid_sim.doctor.run import SearchProgress


def test_where_there_is_no_terminal_ten_seconds_are_a_line():
    stream, ranking = io.StringIO(), Ranking()
    with SearchProgress(Console(file=stream, width=100), ranking) as progress:
        for done in range(4):
            ranking.seconds = 1.0 + 6.0 * done
            progress(done, 3)
    assert stream.getvalue().splitlines() == ["changes: 2 of 3 tried, 13 s so far"]
