"""Layouts of gamepads: of a file of our own, of a ROS 2 parameter file, and wrong ones."""

import pytest

from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.errors import InputError
from humanoid_sim.frontends.gamepad.layout import PadLayout, Sticks, chosen_layout

SWAPPED = JoyBindings(damp_button=3, load_combo_a=(4, 1), load_combo_b=(4, 0))


def layout(tmp_path, text):
    file = tmp_path / "pad.yaml"
    file.write_text(text, encoding="utf-8")
    return chosen_layout(file, PadLayout(), "--mapping")


@pytest.mark.parametrize(
    "text",
    [
        "joy: {damp_button: 3, load_combo_a: [4, 1], load_combo_b: [4, 0]}",
        "mode_manager: {ros__parameters: {tick_rate_hz: 50.0, joy: {damp_button: 3, load_combo_a: [4, 1], "
        "load_combo_b: [4, 0]}}}",
        "mode_manager:\n  ros__parameters:\n    joy.damp_button: 3\n    joy.load_combo_a: [4, 1]\n"
        "    joy.load_combo_b: [4, 0]\n",
        "/**: {ros__parameters: {joy.damp_button: 1, joy: {load_combo_a: [4, 1]}}}\n"
        "mode_manager: {ros__parameters: {joy.damp_button: 3, joy: {load_combo_b: [4, 0]}}}\n",
    ],
)
def test_the_same_layout_in_four_spellings(tmp_path, text):
    assert layout(tmp_path, text) == PadLayout(SWAPPED)


def test_sticks_are_read_and_options_say_only_what_differs(tmp_path):
    found = layout(tmp_path, "sticks: {turn_axis: 3, dead_zone: 0.2}\njoy: {quit_button: 8}")
    assert found == PadLayout(JoyBindings(quit_button=8), Sticks(turn_axis=3, dead_zone=0.2))
    words = ("--joy.quit-button", "8", "--sticks.turn-axis", "3", "--sticks.dead-zone", "0.2")
    assert found.options() == words
    assert PadLayout().options() == ()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "has no buttons, expected a mapping joy:"),
        ("[1, 2]", "has no buttons, expected a mapping joy:"),
        ("buttons: {damp_button: 3}", "unknown section 'buttons'; known: joy, sticks"),
        ("joy: {damp_buton: 3}", "joy: unknown field 'damp_buton' .did you mean 'damp_button'.."),
        ("joy: {damp_button: X}", "joy: Expected `int`, got `str` - at `..damp_button`"),
        ("joy: 3", "joy: Expected `object`, got `int`"),
        ("joy: {damp_button: 4}", "joy: JoyBindings.damp_button: .4,. is pressed whenever load_combo_a"),
        ("standby_controller_a: {ros__parameters: {joints: [a]}}", "unknown section 'standby_controller_a'"),
    ],
)
def test_a_file_without_a_layout_is_one_line(tmp_path, text, why):
    with pytest.raises(InputError, match=rf"^{tmp_path}/pad.yaml: {why}"):
        layout(tmp_path, text)


def test_a_file_and_options_exclude_each_other(tmp_path):
    with pytest.raises(InputError, match=r"^--mapping and --joy.damp-button: both say where the buttons are"):
        chosen_layout(tmp_path / "pad.yaml", PadLayout(SWAPPED), "--mapping")
