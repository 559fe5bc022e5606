"""YAML files that cannot be read, or say something else than is expected, are one line with the place."""

import msgspec
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.strict_yaml import converted, read_yaml


class Wheel(msgspec.Struct):
    radius: float


class Cart(msgspec.Struct):
    wheels: list[Wheel]


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ({"wheels": [{"radius": 1}, {"radius": "x"}]}, "wheels[1].radius: Expected `float`, got `str`"),
        ({}, "Object missing required field `wheels`"),
    ],
)
def test_the_field_comes_first(document, problem):
    with pytest.raises(InputError) as caught:
        converted(document, Cart, "cart.yaml")
    assert str(caught.value) == f"cart.yaml: {problem}"


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"a: [", "line "),
        (b"a: 1\na: 2", "line 2, column 1: not valid YAML: 'a' is given twice"),
        (b"\xff", "not YAML that can be read: "),
    ],
)
def test_a_file_that_cannot_be_read_is_one_line_with_its_place(tmp_path, data, problem):
    (tmp_path / "x.yaml").write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_yaml(tmp_path / "x.yaml")
    assert str(caught.value).startswith(f"{tmp_path}/x.yaml: {problem}")
