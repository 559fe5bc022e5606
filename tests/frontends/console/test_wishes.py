import pytest

from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.console.sliders import Goals
from humanoid_sim.frontends.console.wishes import Beat, LetGo, Press, Snap, Steer, Take, parse_wish


@pytest.mark.parametrize(
    ("message", "wish"),
    [
        ('{"do": "take", "joint": "elbow"}', Take("elbow")),
        ('{"do": "snap"}', Snap()),
        ('{"do": "let_go"}', LetGo()),
        ('{"do": "beat", "seen": 1.5}', Beat(1.5)),
        ('{"do": "beat", "seen": 2, "number": 3, "goals": {"position": 1}}', Beat(2.0, 3, Goals(1.0))),
        ('{"do": "steer", "axis": 1, "value": -0.25}', Steer(1, -0.25)),
        ('{"do": "press", "key": "w"}', Press("w")),
    ],
)
def test_what_pages_send(message, wish):
    assert parse_wish(message) == wish


@pytest.mark.parametrize(
    "message",
    [
        "",
        "{",
        "[]",
        '{"ask": "damp"}',
        "[" * 5000,
        b"\x00\xff",
        '{"do": "fly"}',
        '{"do": "take"}',
        '{"do": "take", "joint": 3}',
        '{"do": "take", "joint": "elbow", "gain": 1}',
        '{"do": "beat"}',
        '{"do": "beat", "seen": "now"}',
        '{"do": "beat", "seen": NaN}',
        '{"do": "beat", "seen": Infinity}',
        '{"do": "beat", "seen": 1e999}',
        '{"do": "beat", "seen": null}',
        '{"do": "beat", "seen": true}',
        '{"do": "beat", "seen": 1, "goals": {"position": NaN}}',
        '{"do": "beat", "seen": 1, "goals": {"position": "1"}}',
        '{"do": "beat", "seen": 1, "goals": {"position": [1]}}',
        '{"do": "beat", "seen": 1, "goals": {"stiffness": 1}}',
        '{"do": "beat", "seen": 1, "goals": {"position": 1, "stifness": 1}}',
        '{"do": "beat", "seen": 1, "number": 1.5}',
        '{"do": "steer", "axis": "0", "value": 1}',
        '{"do": "press", "key": 1}',
        '{"do": "snap", "x": "\\ud800"}',
    ],
)
def test_a_wish_with_a_field_that_is_wrong_is_refused(message):
    with pytest.raises(FieldError, match=r"^not understood: "):
        parse_wish(message)


def test_a_huge_whole_number_is_refused_or_a_number():
    """None of them ends as something that is not a number of a float's."""
    for digits in (30, 308, 400, 5000):
        try:
            wish = parse_wish('{"do": "beat", "seen": ' + "9" * digits + "}")
        except FieldError:
            continue
        assert isinstance(wish, Beat)
        assert 0.0 < wish.seen < float("inf")
