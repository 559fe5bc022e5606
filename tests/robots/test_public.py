"""Public robots by name: from robot_descriptions' own cache, and one line where they cannot be had."""

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot

pytest.importorskip("robot_descriptions")
pytestmark = pytest.mark.peers


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("robot_descriptions:unitree_g1", "known: g1"),
        ("robot_descriptions:talso", "did you mean 'talos'?"),
        ("robot_descriptions:zzzz", "known: a1, "),
        ("mine", "or a file that exists"),
    ],
)
def test_a_wrong_name_gives_the_near_ones_in_one_line(name, message):
    with pytest.raises(InputError) as caught:
        load_robot(name)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
