"""YAML from strangers: quick where it is sound, and never a crash."""

from typing import Literal, get_args

import msgspec
import pytest

from humanoid_sim import strict_yaml
from humanoid_sim.errors import InputError


class Wheel(msgspec.Struct):
    radius: float | None = None
    side: Literal["left", "right"] = "left"


class Cart(msgspec.Struct):
    wheels: list[str | Wheel] = []


DOCUMENT = {"wheels": [{"radius": 1}, {"radius": 2}]}


@pytest.mark.parametrize(
    ("place", "value"),
    [("", DOCUMENT), ("wheels[1].radius", 2), ("wheels[7].radius", DOCUMENT["wheels"]), ("axle", DOCUMENT)],
)
def test_the_value_at_a_place_or_the_last_on_the_way(place, value):
    assert strict_yaml.value_at(DOCUMENT, place) == value


def test_the_type_at_a_place():
    assert strict_yaml.type_at(Cart, "") is Cart
    assert strict_yaml.type_at(Cart, "wheels[0]") is Wheel
    assert strict_yaml.type_at(Cart, "wheels[0].radius") is float
    assert get_args(strict_yaml.type_at(Cart, "wheels[3].side")) == ("left", "right")


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"a: [", "x: line "),
        (b"a: 1\na: 2", "x: line 2, column 1: not valid YAML: 'a' is given twice"),
        (b"\xff", "x: is not a text file (UTF-8), expected a YAML file"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_line_with_its_place(tmp_path, data, problem):
    (tmp_path / "x.yaml").write_bytes(data)
    with pytest.raises(InputError) as caught:
        strict_yaml.read_yaml(tmp_path / "x.yaml", "x")
    assert str(caught.value).startswith(problem)
