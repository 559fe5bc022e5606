from __future__ import annotations

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.mit import VELOCITY_COMMAND
from humanoid_sim.session.velocity import VELOCITY_KEYS, VelocityCommand, parse_velocity

RANGES = np.array([[-0.5, 1.0], [-0.5, 0.5], [-1.0, 1.0]])


def test_three_numbers() -> None:
    assert parse_velocity(" 0.5, -0.25,1", RANGES).tolist() == [0.5, -0.25, 1.0]


@pytest.mark.parametrize("text", ["", "1", "1,2", "1,2,3,4", "a,b,c", "nan,0,0", "0,inf,0"])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=f"^--command: is '{text}', expected vx,vy,wz"):
        parse_velocity(text, None)


@pytest.mark.parametrize(("text", "name"), [("1.1,0,0", "vx"), ("0,-0.6,0", "vy"), ("0,0,2", "wz")])
def test_beyond_the_ranges_is_refused(text: str, name: str) -> None:
    with pytest.raises(InputError, match=f"^--command: {name} is "):
        parse_velocity(text, RANGES)


def test_keys_add_up_within_the_ranges() -> None:
    velocity = VelocityCommand(np.zeros(3), RANGES)
    for _ in range(12):
        velocity.press("w")
    velocity.press("j")
    velocity.press("x")
    assert velocity.command.tolist() == [1.0, 0.0, 0.1]
    assert velocity.latest()[VELOCITY_COMMAND].value.tolist() == [1.0, 0.0, 0.1]
    velocity.press("0")
    assert velocity.command.tolist() == [0.0, 0.0, 0.0]


def test_every_direction_has_its_keys() -> None:
    changes = np.array([change for change in VELOCITY_KEYS.values() if any(change)])
    assert sorted(map(tuple, changes.tolist())) == sorted(
        [(0.1, 0, 0), (-0.1, 0, 0), (0, 0.1, 0), (0, -0.1, 0), (0, 0, 0.1), (0, 0, -0.1)]
    )


def test_the_command_does_not_grow_old() -> None:
    live = VelocityCommand(np.array([0.5, 0.0, 0.0])).latest()[VELOCITY_COMMAND]
    assert live.at(1e6).tolist() == [0.5, 0.0, 0.0]
