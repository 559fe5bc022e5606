"""YAML from strangers: quick where it is sound, and never a crash."""

from typing import Literal, get_args

import msgspec
import pytest
import yaml

from humanoid_sim import strict_yaml
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot


def test_the_quick_loader_reads_what_the_other_reads():
    text = (load_robot("lite").mjcf_path.parent.parent / "robots" / "lite.yaml").read_text(encoding="utf-8")
    assert strict_yaml.load_strictly(text) == yaml.load(text, strict_yaml.StrictLoader)


@pytest.mark.parametrize("text", ["a: 1\na: 2\n", 'a: "\\0"', "a: !!python/object:os.system {}\n"])
def test_both_loaders_are_strict(text):
    with pytest.raises(yaml.YAMLError) as strict:
        yaml.load(text, strict_yaml.StrictLoader)
    with pytest.raises(yaml.YAMLError) as quick:
        strict_yaml.load_strictly(text)
    assert str(quick.value) == str(strict.value)


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
        (b"a: [", "x: line 1, column 5: not valid YAML: "),
        (b"a: 1\na: 2", "x: line 2, column 1: not valid YAML: 'a' is given twice"),
        (b"\xff", "x: is not a text file (UTF-8), expected a YAML file"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_line_with_its_place(tmp_path, data, problem):
    (tmp_path / "x.yaml").write_bytes(data)
    with pytest.raises(InputError) as caught:
        strict_yaml.read_yaml(tmp_path / "x.yaml", "x")
    assert str(caught.value).startswith(problem)


BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (BOMB, "more than 100000 values"),
        (
            "p: &p {k: 1}\nq: &q {<<: [*p, *p]}\n" + BOMB.replace("[", "{<<: [").replace("]", "]}"),
            "more than 100000 values",
        ),
        ("a: &a [1, *a]\n", "an alias stands for what it is in"),
        (f"a: {'y' * 70_000}\n", "a text of 70000 characters, expected at most 65536"),
    ],
    ids=["aliases", "merges", "recursion", "a long text"],
)
def test_a_small_file_stays_small(text, problem):
    for load in (strict_yaml.load_strictly, lambda text: yaml.load(text, strict_yaml.StrictLoader)):
        with pytest.raises(yaml.YAMLError) as refused:
            load(text)
        assert problem in str(refused.value)


def test_a_large_file_is_not_read(tmp_path):
    path = tmp_path / "large.yaml"
    path.write_text("#" * (1 << 20) + "\n")
    with pytest.raises(InputError) as refused:
        strict_yaml.read_yaml(path)
    assert str(refused.value) == f"{path}: has 1048577 bytes, expected a YAML file of at most 1048576"
