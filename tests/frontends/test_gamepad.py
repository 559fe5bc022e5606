"""The gamepad's driver on gamepads that SDL makes, against a session without a loop."""

import os
import time

import numpy as np
import pytest

pytest.importorskip("pygame", reason="pygame-ce is not installed (extra 'gamepad')")

from virtual_pads import VirtualPad

from humanoid_sim.frontends.gamepad.device import Pads, missing_reason
from humanoid_sim.frontends.gamepad.layout import PadLayout, Sticks, chosen_layout, speed_range
from humanoid_sim.gamepad import Driver, GamepadConfig
from humanoid_sim.messages import Intent, Mode

SPEEDS = speed_range(np.array([[-0.4, 0.8], [-0.2, 0.2], [-1.0, 1.0]]))


@pytest.fixture(scope="module")
def pads():
    pads = Pads()
    yield pads
    pads.close()


@pytest.fixture
def pad(pads):
    pad = VirtualPad()
    yield pad
    pad.unplug()
    pads.look()


class Desk:
    """A driver on a session; `look` is a look at the gamepads and the session's next tick."""

    def __init__(self, local, pads, config=None, *, hardware=False):
        self.local, self.pads = local, pads
        self.driver = Driver(local.intake("gamepad"), config or GamepadConfig(), speeds=SPEEDS, is_hardware=hardware)

    def look(self, ticks=1):
        lines = self.driver.step(self.pads.look())
        for _ in range(ticks):
            self.mode = self.local.tick().output.control_mode.mode
        return lines

    def press(self, pad, *buttons):
        """One after the other, a look each; then all are released."""
        for button in buttons:
            pad.press(button)
            self.look()
        mode = self.mode
        pad.release(*buttons)
        self.look()
        return mode


def test_buttons_walk_through_the_modes(local, pads, pad):
    desk = Desk(local, pads)
    assert desk.look() == ["Test Pad (8 buttons, known layout) drives"]
    assert desk.press(pad, "X") is Mode.DAMPING
    assert desk.press(pad, "L1", "A") is Mode.STANDBY
    desk.look(10)
    assert desk.press(pad, "R1", "B") is Mode.REMOTE
    assert desk.press(pad, "X") is Mode.DAMPING
    assert desk.press(pad, "L1", "B") is Mode.STANDBY
    assert desk.press(pad, "X") is Mode.DAMPING


def test_a_combination_that_is_held_acts_once_and_in_any_order(local, pads, pad):
    desk = Desk(local, pads)
    desk.look()
    assert desk.press(pad, "X") is Mode.DAMPING
    pad.press("A")
    desk.look()
    pad.press("L1")
    desk.look()
    assert desk.mode is Mode.STANDBY
    pad.press("X")
    desk.look()
    assert desk.mode is Mode.DAMPING
    pad.release("X")
    desk.look(5)
    assert desk.mode is Mode.DAMPING, "L1 and A are still down"
    pad.release("A")
    desk.look()
    pad.press("A")
    desk.look()
    assert desk.mode is Mode.STANDBY


def test_only_the_chosen_pad_drives_and_every_pad_damps(local, pads, pad):
    second = VirtualPad("Second Pad")
    try:
        desk = Desk(local, pads, GamepadConfig(device="second"))
        assert desk.look() == ["Second Pad (8 buttons, known layout) drives"]
        assert desk.press(second, "X") is Mode.DAMPING
        assert desk.press(pad, "L1", "A") is Mode.DAMPING
        assert desk.press(second, "L1", "A") is Mode.STANDBY
        assert desk.press(pad, "X") is Mode.DAMPING
    finally:
        second.unplug()


def test_a_foreign_layout_is_bound_by_its_own_numbers_or_not_used(local, pads):
    odd = VirtualPad("Odd Pad", known=False, buttons=4, axes=2)
    try:
        refused = Desk(local, pads)
        (line,) = refused.look()
        assert line.startswith("Odd Pad (4 buttons, unknown layout) is not used: JoyBindings.load_combo_a: is (4, 0)")
        assert refused.look() == [], "told once"
    finally:
        odd.unplug()


def test_a_layout_file_swaps_the_buttons(local, pads, pad, tmp_path):
    file = tmp_path / "pad.yaml"
    file.write_text(
        "mode_manager: {ros__parameters: {joy: {damp_button: 3, load_combo_a: [4, 1], load_combo_b: [4, 0]}}}"
    )
    layout = chosen_layout(file, PadLayout(), "--mapping")
    desk = Desk(local, pads, GamepadConfig(joy=layout.joy, sticks=layout.sticks))
    assert desk.press(pad, "X") is Mode.ZERO_TORQUE
    assert desk.press(pad, "Y") is Mode.DAMPING
    assert desk.press(pad, "L1", "B") is Mode.STANDBY
    assert local.tick().output.control_mode.controller_name == "standby_controller_a"


def test_sticks_steer_and_one_at_rest_claims_nothing(local, pads, pad):
    desk = Desk(local, pads)
    desk.look()
    local.velocity.press("w")  # the keyboard's, until somebody pushes a stick
    desk.look(2)
    np.testing.assert_allclose(local.velocity.command, [0.1, 0.0, 0.0])
    pad.push(1, -1.0)
    desk.look(2)
    np.testing.assert_allclose(local.velocity.command, [0.8, 0.0, 0.0])
    pad.push(1, 0.1)  # in the dead zone
    pad.push(2, 1.0)
    desk.look(2)
    np.testing.assert_allclose(local.velocity.command, [0.0, 0.0, -1.0])
    pad.push(2, 0.0)
    desk.look(2)
    np.testing.assert_allclose(local.velocity.command, [0.0, 0.0, 0.0])
    local.velocity.press("w")
    desk.look(2)
    np.testing.assert_allclose(local.velocity.command, [0.1, 0.0, 0.0])


@pytest.mark.parametrize(
    ("axes", "velocity"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, -0.15, 0.15), (0.0, 0.0, 0.0)),
        ((0.0, -0.575, 0.0), (0.4, 0.0, 0.0)),
        ((-1.0, 1.0, 1.0), (-0.4, 0.2, -1.0)),
        ((), (0.0, 0.0, 0.0)),
    ],
)
def test_a_stick_s_way_is_the_policy_s_range(axes, velocity):
    np.testing.assert_allclose(Sticks().velocity(axes, SPEEDS), velocity, atol=1e-12)


@pytest.mark.soak
def test_what_was_pressed_while_the_program_stood_still_moves_nothing_but_damps(local, pads, pad):
    desk = Desk(local, pads)
    desk.look()
    desk.press(pad, "X")
    pad.press("L1", "A")
    time.sleep(0.6)
    desk.look()
    assert "too late, it was meant for the robot of" in local.told[-1]
    assert desk.mode is Mode.DAMPING
    pad.release("A")
    desk.look()
    pad.press("A")
    desk.look()
    assert desk.mode is Mode.DAMPING, "it may have been pressed before, and be heard only now"
    pad.release("A")
    time.sleep(0.6)
    desk.look()
    local.tick(Intent.DAMP)
    local.tick(Intent.LOAD_A)
    pad.press("X")
    time.sleep(0.6)
    desk.look()
    assert desk.mode is Mode.DAMPING


def test_a_missing_gamepad_is_explained_by_its_device_nodes(tmp_path, monkeypatch):
    assert missing_reason(tmp_path / "input") == f"no gamepad is plugged in: {tmp_path / 'input'} has no event nodes"
    for name in ("event0", "event1"):
        (tmp_path / name).touch()
    assert missing_reason(tmp_path) == "no gamepad is plugged in"
    monkeypatch.setattr(os, "access", lambda path, _: path.name != "event1")
    text = missing_reason(tmp_path)
    assert f"1 of 2 event nodes, such as {tmp_path / 'event1'}, are for group '{(tmp_path / 'event1').group()}'" in text
