"""JSON from strangers."""

import re

import pytest

from humanoid_sim.strict_json import parse_json


def test_what_is_json_is_read():
    assert parse_json('{"a": [1, 2.5, null]}') == {"a": [1, 2.5, None]}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[" * 100_000, "is nested too deeply"),
        ("{", "Expecting property name enclosed in double quotes: line 1 column 2 (char 1)"),
        ("9" * 5000, "Exceeds the limit (4300 digits) for integer string conversion"),
        (b"\xff\xfe\xfd", "codec can't decode"),
    ],
    ids=["deep", "cut", "a long number", "no text"],
)
def test_what_is_none_is_one_kind_of_error(text, problem):
    with pytest.raises(ValueError, match=re.escape(problem)) as refused:
        parse_json(text)
    assert "\n" not in str(refused.value)
