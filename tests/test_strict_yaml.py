"""YAML from strangers: quick where it is sound, and never a crash."""

from __future__ import annotations

import pytest
import yaml

from humanoid_sim.robots.description import load_robot
from humanoid_sim.strict_yaml import UNREADABLE, StrictLoader, load_strictly


def test_the_quick_loader_reads_what_the_other_reads() -> None:
    text = (load_robot("lite").mjcf_path.parent.parent / "robots" / "lite.yaml").read_text(encoding="utf-8")
    assert load_strictly(text) == yaml.load(text, StrictLoader)


@pytest.mark.parametrize(
    "text",
    [
        "a: " + "[" * 200_000 + "]" * 200_000,
        "{a: " * 200_000,
        "- " * 200_000,
        "\n".join(" " * i + "a:" for i in range(3000)),
    ],
    ids=["brackets", "braces", "dashes", "indentation"],
)
def test_no_depth_ends_the_process(text: str) -> None:
    with pytest.raises((yaml.YAMLError, *UNREADABLE)):
        load_strictly(text)


@pytest.mark.parametrize("text", ["a: 1\na: 2\n", 'a: "\\0"', "a: !!python/object:os.system {}\n"])
def test_both_loaders_are_strict(text: str) -> None:
    with pytest.raises(yaml.YAMLError) as strict:
        yaml.load(text, StrictLoader)
    with pytest.raises(yaml.YAMLError) as quick:
        load_strictly(text)
    assert str(quick.value) == str(strict.value)
