"""Gamepad bindings: the defaults, remapping, edges, and gamepads that cannot work."""

from itertools import combinations

import pytest

from humanoid_sim.controllers.joy import JoyBindings, pressed_intents
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import Intent

A, B, X, Y, L1, R1, BACK, START = range(8)
DEFAULTS = {
    Intent.DAMP: {2},
    Intent.QUIT: {6},
    Intent.LOAD_A: {4, 0},
    Intent.LOAD_B: {4, 1},
    Intent.START_LOCOMOTION: {5, 0},
    Intent.START_REMOTE: {5, 1},
}


def buttons(*down, count=8):
    return tuple(int(i in down) for i in range(count))


def test_an_intent_comes_when_its_combination_is_completed():
    """Between any two readings with up to three buttons down."""
    readings = [set(down) for size in range(4) for down in combinations(range(8), size)]
    bindings = JoyBindings()
    for before in readings:
        for now in readings:
            wanted = {intent for intent, combo in DEFAULTS.items() if combo <= now and not combo <= before}
            assert set(pressed_intents(bindings, buttons(*now), buttons(*before))) == wanted


def test_a_gamepad_that_connects_with_buttons_held_can_only_damp():
    bindings = JoyBindings()
    assert pressed_intents(bindings, buttons(L1, A, BACK, R1, B), ()) == ()
    assert pressed_intents(bindings, buttons(X, L1, A), ()) == (Intent.DAMP,)
    assert pressed_intents(bindings, (), buttons(X)) == ()


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"damp_button": -1}, "damp_button"),
        ({"load_combo_a": ()}, "load_combo_a"),
        ({"start_combo_locomotion": (5, 5)}, "start_combo_locomotion"),
        ({"quit_button": 2}, r"damp_button: \(2,\) is pressed whenever quit_button"),
        ({"start_combo_remote": (5,)}, r"start_combo_remote: \(5,\) is pressed whenever start_combo_locomotion"),
    ],
)
def test_bindings_that_cannot_work_are_refused(changes, field):
    with pytest.raises(FieldError, match=f"^JoyBindings.{field}"):
        JoyBindings(**changes)
