"""The gamepad's driver against a session without a loop."""

import os
import time

import numpy as np
import pytest
from fake_pads import BLUETOOTH, DUALSENSE, JOYSTICK, XBOX, FakePads

from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.errors import InputError
from humanoid_sim.frontends.gamepad.layout import PadLayout, chosen_layout, stick_velocity
from humanoid_sim.gamepad import Driver, GamepadConfig
from humanoid_sim.messages import Intent, Mode

SPEEDS = np.array([[-0.4, 0.8], [-0.2, 0.2], [-1.0, 1.0]])


@pytest.fixture
def pads(tmp_path):
    (tmp_path / "input").mkdir()
    pads = FakePads(tmp_path / "input")
    yield pads
    pads.close()


@pytest.fixture
def pad(pads):
    return pads.plug()


class Desk:
    """A driver on a session; `poll` is a poll of the gamepads and the session's next tick."""

    def __init__(self, local, pads, config=None, *, hardware=False):
        self.local, self.pads = local, pads
        self.driver = Driver(local.intake("gamepad"), config or GamepadConfig(), speeds=SPEEDS, is_hardware=hardware)

    def poll(self, ticks=1):
        lines = self.driver.step(self.pads.poll())
        for _ in range(ticks):
            self.mode = self.local.tick().output.control_mode.mode
        return lines

    def press(self, pad, *buttons):
        """One after the other, a poll each; then all are released."""
        for button in buttons:
            pad.press(button)
            self.poll()
        mode = self.mode
        pad.release(*buttons)
        self.poll()
        return mode


@pytest.mark.parametrize("codes", [XBOX, DUALSENSE, BLUETOOTH], ids=["xpad", "DualSense", "Bluetooth"])
def test_buttons_lead_through_the_modes_on_each_maker_s_pad(local, pads, codes):
    pad = pads.plug(codes)
    desk = Desk(local, pads)
    assert desk.poll() == ["Test Pad drives"]
    assert desk.press(pad, "X") is Mode.DAMPING
    assert desk.press(pad, "L1", "A") is Mode.STANDBY
    desk.poll(10)
    assert desk.press(pad, "R1", "B") is Mode.REMOTE
    assert desk.press(pad, "X") is Mode.DAMPING
    assert desk.press(pad, "L1", "B") is Mode.STANDBY
    assert desk.press(pad, "X") is Mode.DAMPING


def test_a_combination_that_is_held_acts_once_and_in_any_order(local, pads, pad):
    desk = Desk(local, pads)
    assert desk.press(pad, "X") is Mode.DAMPING
    for button in ("A", "L1"):
        pad.press(button)
        desk.poll()
    assert desk.mode is Mode.STANDBY
    desk.press(pad, "X")
    desk.poll(5)
    assert desk.mode is Mode.DAMPING, "L1 and A are still down"
    pad.release("A")
    desk.poll()
    pad.press("A")
    desk.poll()
    assert desk.mode is Mode.STANDBY


def test_a_button_that_is_released_within_one_poll_counts(local, pads, pad):
    desk = Desk(local, pads)
    desk.poll()
    pad.press("X")
    pad.release("X")
    desk.poll()
    assert desk.mode is Mode.DAMPING


def test_buttons_that_are_down_when_it_comes_count_only_for_what_is_pressed_later(local, pads):
    pad = pads.plug(held=("L1", "A"))
    desk = Desk(local, pads)
    desk.poll(2)
    assert desk.mode is Mode.ZERO_TORQUE
    desk.press(pad, "X")
    pad.press("B")
    desk.poll()
    assert desk.mode is Mode.STANDBY, "L1 is down"


def test_only_the_chosen_pad_drives_and_every_pad_damps(local, pads, pad):
    second = pads.plug(name="Second Pad")
    desk = Desk(local, pads, GamepadConfig(device="second"))
    assert desk.poll() == ["Second Pad drives"]
    assert desk.press(second, "X") is Mode.DAMPING
    assert desk.press(pad, "L1", "A") is Mode.DAMPING
    assert desk.press(second, "L1", "A") is Mode.STANDBY
    assert desk.press(pad, "X") is Mode.DAMPING


def test_an_unknown_pad_or_one_that_lacks_a_bound_button_is_not_used(local, pads, pad):
    odd = pads.plug(JOYSTICK, "Odd Pad")
    desk = Desk(local, pads, GamepadConfig(device="odd"))
    assert desk.poll() == ["Odd Pad is not used: its layout is not known; many have a switch for Xbox pads (XInput)"]
    assert desk.poll() == []
    assert desk.press(odd, 2) is Mode.ZERO_TORQUE
    desk = Desk(local, pads, GamepadConfig(joy=JoyBindings(damp_button=9)))
    assert "Test Pad is not used: JoyBindings.damp_button: is (9,)" in desk.poll()[0]


def test_sticks_steer_and_one_at_rest_claims_nothing(local, pads, pad):
    desk = Desk(local, pads)
    desk.poll()
    local.velocity.press("w")  # the keyboard's, until somebody pushes a stick
    desk.poll(2)
    np.testing.assert_allclose(local.velocity.command, [0.1, 0.0, 0.0])
    pad.push(1, -1.0)
    desk.poll(2)
    np.testing.assert_allclose(local.velocity.command, [0.8, 0.0, 0.0])
    pad.push(1, 0.1)  # in the dead zone
    pad.push(3, 1.0)  # the right stick, behind the left trigger
    desk.poll(2)
    np.testing.assert_allclose(local.velocity.command, [0.0, 0.0, -1.0])
    pad.push(3, 0.0)
    desk.poll(2)
    local.velocity.press("w")
    desk.poll(2)
    np.testing.assert_allclose(local.velocity.command, [0.1, 0.0, 0.0])


@pytest.mark.parametrize(
    ("axes", "velocity"),
    [
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, -0.15, 0.15, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, -0.575, 0.0, 0.0), (0.4, 0.0, 0.0)),
        ((-1.0, 1.0, 1.0, 0.0), (-0.4, 0.2, -1.0)),
    ],
)
def test_a_stick_s_way_is_the_policy_s_range(axes, velocity):
    np.testing.assert_allclose(stick_velocity(axes, SPEEDS), velocity, atol=1e-12)


@pytest.mark.soak
def test_what_was_pressed_while_the_program_was_suspended_moves_nothing_but_damps(local, pads, pad):
    desk = Desk(local, pads)
    desk.press(pad, "X")
    pad.press("L1", "A")
    time.sleep(0.6)
    desk.poll()
    assert desk.mode is Mode.DAMPING
    pad.release("A")
    desk.poll()
    local.tick(Intent.DAMP)
    local.tick(Intent.LOAD_A)
    pad.press("X")
    time.sleep(0.6)
    desk.poll()
    assert desk.mode is Mode.DAMPING


@pytest.mark.parametrize(
    "text",
    [
        "joy: {damp_button: 3, load_combo_a: [4, 1], load_combo_b: [4, 0]}",
        "mode_manager: {ros__parameters: {joy: {damp_button: 3, load_combo_a: [4, 1], load_combo_b: [4, 0]}}}",
        "/**: {ros__parameters: {joy.damp_button: 3, joy.load_combo_a: [4, 1], joy.load_combo_b: [4, 0], other: 1}}",
    ],
)
def test_a_file_binds_the_buttons(text, tmp_path):
    file = tmp_path / "pad.yaml"
    file.write_text(text)
    layout = chosen_layout(file, PadLayout(), "--mapping")
    assert layout.joy == JoyBindings(damp_button=3, load_combo_a=(4, 1), load_combo_b=(4, 0))
    options = ("--joy.damp-button", "3", "--joy.load-combo-a", "4", "1", "--joy.load-combo-b", "4", "0")
    assert layout.options() == options
    with pytest.raises(InputError, match=r"--mapping and --joy\.damp-button"):
        chosen_layout(file, layout, "--mapping")


@pytest.mark.parametrize(
    ("text", "named"),
    [("[1]", "no buttons"), ("joi: {}", "joi"), ("joy: {damp: 1}", "damp"), ("joy: {damp_button: x}", "damp_button")],
)
def test_a_file_that_is_no_layout_is_refused(text, named, tmp_path):
    file = tmp_path / "pad.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=rf"pad\.yaml: .*{named}"):
        chosen_layout(file, PadLayout(), "--mapping")


def test_a_missing_gamepad_is_explained_by_its_device_nodes(tmp_path, monkeypatch):
    assert f"{tmp_path} has no js*" in FakePads(tmp_path).missing_reason()
    (tmp_path / "js0").touch()
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert f"js0 is for group '{(tmp_path / 'js0').group()}'" in FakePads(tmp_path).missing_reason()
