import pytest

from tools.bench import timing
from tools.bench.timing import Row, paired_ratio, row_of, seconds


class FakeClock:
    """Time passes only in what is timed."""

    def __init__(self, monkeypatch):
        self.now = 5.0
        monkeypatch.setattr(timing, "perf_counter", lambda: self.now)

    def spend(self, *durations):
        """An action that takes these times in turn, s."""
        left = list(durations)

        def action():
            self.now += left.pop(0)

        return action


def test_seconds(monkeypatch):
    clock = FakeClock(monkeypatch)
    assert seconds(clock.spend(0.25)) == 0.25


def test_a_ratio_is_the_median_of_pairs_and_the_first_pair_does_not_count(monkeypatch):
    clock = FakeClock(monkeypatch)
    action, bare = clock.spend(100.0, 2.0, 9.0, 4.0), clock.spend(1.0, 1.0, 3.0, 1.0)
    row = paired_ratio("x", action, bare, 3, 2.5, lambda a, b: f"{a:g} over {b:g}")
    assert row == Row("x", 3.0, "ratio", 2.0, 4.0, 2.5, "4 over 1")
    assert not row.is_met


def test_a_ratio_of_speeds_and_what_is_not_timed(monkeypatch):
    clock = FakeClock(monkeypatch)
    action, bare = clock.spend(1.0, 2.0), clock.spend(1.0, 5.0)
    prepare = clock.spend(*[100.0] * 4)
    row = paired_ratio("x", action, bare, 1, 1.9, lambda a, b: f"{a:g} over {b:g}", speed=True, prepare=prepare)
    assert row == Row("x", 2.5, "ratio", 2.5, 2.5, 1.9, "2 over 5", at_least=True)
    assert row.is_met


def test_a_row_of_repetitions_is_their_median_and_range():
    assert row_of("x", [3.0, 1.0, 7.0], "µs") == Row("x", 3.0, "µs", 1.0, 7.0)


@pytest.mark.parametrize(
    ("value", "target", "at_least", "met"),
    [
        (2.5, 2.5, False, True), (2.51, 2.5, False, False), (99.0, None, False, True),
        (1.9, 1.9, True, True), (1.89, 1.9, True, False), (0.1, None, True, True),
    ],
)  # fmt: skip
def test_a_target_is_an_upper_bound_and_that_of_a_speed_a_lower_one(value, target, at_least, met):
    assert Row("x", value, "ratio", 0.0, 100.0, target, at_least=at_least).is_met == met
