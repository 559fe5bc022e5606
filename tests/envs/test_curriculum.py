"""Curricula that are written down as points."""

import pytest

from humanoid_sim.envs.curriculum import amounts_at, scheduled
from humanoid_sim.errors import InputError


def test_amounts_change_evenly_from_point_to_point_and_hold_before_and_after():
    curriculum = scheduled({"commands": 0.3, "push": [[0.5, 0.0], [0.75, 1]], "terrain": [[0, 0.2], [1, 0.6]]})
    assert curriculum(0.0) == {"commands": 0.3, "push": 0.0, "terrain": 0.2}
    assert curriculum(0.625) == pytest.approx({"commands": 0.3, "push": 0.5, "terrain": 0.45})
    assert curriculum(1.0) == pytest.approx({"commands": 0.3, "push": 1.0, "terrain": 0.6})
    amounts = amounts_at(curriculum, 0.5)
    assert (amounts.commands, amounts.terrain, amounts.randomisation["push"]) == (0.3, 0.4, 0.0)
    assert amounts.randomisation["mass"] == 1.0  # what is not named counts in full


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ({"pushes": 1.0}, r"^curriculum: unknown amount 'pushes' \(did you mean 'push'\?\); known: commands, "),
        ({"push": 1.5}, r"^curriculum: push is 1.5, expected a number from 0 to 1, or pairs \[progress, amount\]"),
        ({"push": []}, "push is "),
        ({"push": [0.0, 1.0]}, "expected a number from 0 to 1, or pairs"),
        ({"push": [[0.0, 1.0, 2.0]]}, "expected a number from 0 to 1, or pairs"),
        ({"push": [[0.0, True]]}, "expected a number from 0 to 1, or pairs"),
        ({"push": [[0.5, 0.0], [0.5, 1.0]]}, "expected each progress to be greater than the one before"),
    ],
)
def test_what_is_no_curriculum_is_one_line(points, expected):
    with pytest.raises(InputError, match=expected):
        scheduled(points)
