"""Whether something grows, on figures and on short runs of every scenario."""

import pytest

from tools.studies.endurance import Watched, growth, main


def watched(*columns):
    return Watched("it", [(5.0 * i, *(column(i) for column in columns)) for i in range(40)])


def steady(value):
    return lambda i: value + i % 2


def leaking(value, each):
    return lambda i: value + each * i


@pytest.mark.parametrize(
    ("columns", "grown"),
    [
        ((steady(80.0), steady(50.0), steady(9), steady(3)), []),
        ((steady(80.0), leaking(50.0, 1.0), steady(9), steady(3)), []),  # others who share its pages end
        ((leaking(80.0, 0.3), steady(50.0), steady(9), steady(3)), ["GROWS: it: RSS, MB by 5.7"]),
        ((leaking(80.0, 0.1), steady(50.0), steady(9), steady(3)), []),
        ((steady(80.0), steady(50.0), leaking(9, 0.05), steady(3)), ["GROWS: it: open files by 0.9"]),
        ((steady(80.0), steady(50.0), steady(9), leaking(3, 1)), ["GROWS: it: threads by 19.0"]),
        ([lambda i: 9.0 if 10 <= i < 38 else 90.0] * 4, []),  # as it begins and ends
    ],
)
def test_what_grows_is_told(columns, grown):
    assert growth(watched(*columns)) == grown


@pytest.mark.slow
@pytest.mark.parametrize("options", ["--robot lite --seconds 60", "--scenario vector --seconds 12"])
def test_nothing_grows_in_a_short_run(options, capsys):
    assert main([*options.split(), "--period", "0.2"]) == 0, capsys.readouterr().out
