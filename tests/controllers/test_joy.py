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


def test_every_step_between_two_readings():
    """All 256 x 256 readings: an intent comes exactly when its combination was completed."""
    readings = [set(down) for size in range(9) for down in combinations(range(8), size)]
    bindings = JoyBindings()
    states = [(down, buttons(*down)) for down in readings]
    for before, before_buttons in states:
        for now, now_buttons in states:
            wanted = {intent for intent, combo in DEFAULTS.items() if combo <= now and not combo <= before}
            assert set(pressed_intents(bindings, now_buttons, before_buttons)) == wanted


def test_a_gamepad_that_connects_with_buttons_held_can_only_damp():
    bindings = JoyBindings()
    assert pressed_intents(bindings, buttons(L1, A, BACK, R1, B), ()) == ()
    assert pressed_intents(bindings, buttons(X, L1, A), ()) == (Intent.DAMP,)
    assert pressed_intents(bindings, (), buttons(X)) == ()


def test_remapping():
    bindings = JoyBindings(
        damp_button=9, quit_button=0, load_combo_a=[1, 2, 3], load_combo_b=(1, 4), start_combo_locomotion=(7,)
    )
    assert bindings.load_combo_a == (1, 2, 3)
    for down, intent in (
        ((9,), Intent.DAMP),
        ((0,), Intent.QUIT),
        ((1, 2, 3), Intent.LOAD_A),
        ((1, 4), Intent.LOAD_B),
        ((7,), Intent.START_LOCOMOTION),
        ((5, 1), Intent.START_REMOTE),
    ):
        assert pressed_intents(bindings, buttons(*down, count=10), buttons(count=10)) == (intent,)
    assert pressed_intents(bindings, buttons(2, count=10), buttons(count=10)) == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"damp_button": -1}, r"damp_button: is \(-1,\), expected button indices >= 0"),
        ({"damp_button": "X"}, r"damp_button: is \('X',\), expected button indices"),
        ({"quit_button": True}, r"quit_button: is \(True,\), expected button indices"),
        ({"quit_button": 6.0}, r"quit_button: is \(6.0,\), expected button indices"),
        ({"load_combo_a": ()}, r"load_combo_a: is \(\), expected button indices"),
        ({"load_combo_a": 4}, r"load_combo_a: is 4, expected a list of button indices"),
        ({"load_combo_b": "41"}, r"load_combo_b: is '41', expected a list of button indices"),
        ({"start_combo_remote": None}, r"start_combo_remote: is None, expected a list of button indices"),
        ({"start_combo_locomotion": (5, 5)}, r"start_combo_locomotion: is \(5, 5\), expected each button once"),
        ({"quit_button": 2}, r"damp_button: \(2,\) is pressed whenever quit_button \(2,\) is"),
        ({"load_combo_a": (2, 0)}, r"damp_button: \(2,\) is pressed whenever load_combo_a \(2, 0\) is"),
        ({"load_combo_b": (0, 4)}, r"load_combo_a: \(4, 0\) is pressed whenever load_combo_b \(0, 4\) is"),
        ({"start_combo_remote": (5,)}, r"start_combo_remote: \(5,\) is pressed whenever start_combo_locomotion"),
    ],
)
def test_bindings_that_cannot_work_are_refused(changes, message):
    with pytest.raises(FieldError, match=f"^JoyBindings.{message}"):
        JoyBindings(**changes)


def test_a_gamepad_without_a_bound_button_is_refused():
    JoyBindings().check(7)
    with pytest.raises(FieldError, match=r"^JoyBindings.quit_button: is \(6,\), but the gamepad has buttons 0 to 5$"):
        JoyBindings().check(6)
    with pytest.raises(FieldError, match=r"^JoyBindings.damp_button: is \(2,\), but the gamepad has buttons 0 to 1$"):
        JoyBindings().check(2)
    with pytest.raises(FieldError, match=r"but the gamepad has no buttons$"):
        JoyBindings().check(0)
