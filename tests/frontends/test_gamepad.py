"""The gamepad's driver against a session without a loop."""

import numpy as np
import pytest
from fake_pads import BLUETOOTH, DUALSENSE, XBOX, FakePads

from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.errors import InputError
from humanoid_sim.frontends import pads as pads_module
from humanoid_sim.frontends.joy import read_bindings
from humanoid_sim.gamepad import Driver
from humanoid_sim.messages import Mode

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

    def __init__(self, local, pads):
        self.local, self.pads = local, pads
        self.driver = Driver(local.intake("gamepad"), JoyBindings(), speeds=SPEEDS, is_hardware=False)

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


def test_a_gamepad_that_this_user_may_not_read_is_named(monkeypatch, tmp_path):
    (tmp_path / "js0").touch()
    monkeypatch.setattr(pads_module.os, "access", lambda *_: False)
    assert "js0: this user may not read it: sudo usermod" in pads_module.describe_pads((), tmp_path)[1][0]


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


def test_presses_count_within_one_poll(local, pads):
    pad = pads.plug(held=("L1",))
    desk = Desk(local, pads)
    pad.press("X")
    pad.release("X")
    desk.poll()
    assert desk.mode is Mode.DAMPING
    desk.poll()
    pad.press("B")
    desk.poll()
    assert desk.mode is Mode.STANDBY, "L1 is down"


def test_only_the_first_pad_drives_and_every_pad_damps(local, pads, pad):
    second = pads.plug(name="Second Pad")
    desk = Desk(local, pads)
    assert desk.poll() == ["Test Pad drives"]
    assert desk.press(second, "X") is Mode.DAMPING
    assert desk.press(second, "L1", "A") is Mode.DAMPING
    assert desk.press(pad, "L1", "A") is Mode.STANDBY
    assert desk.press(second, "X") is Mode.DAMPING


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
    "text",
    [
        "joy: {damp_button: 3, load_combo_a: [4, 1], load_combo_b: [4, 0]}",
        "mode_manager: {ros__parameters: {joy: {damp_button: 3, load_combo_a: [4, 1], load_combo_b: [4, 0]}}}",
        "/**: {ros__parameters: {joy.damp_button: 3, joy.load_combo_a: [4, 1], joy.load_combo_b: [4, 0], other: 1}}",
        "/arm/mode_manager: {ros__parameters: {joy: {load_combo_a: [4, 1], load_combo_b: [4, 0], damp_button: 3}}}\n"
        "/**: {ros__parameters: {joy.damp_button: 1}}",
    ],
)
def test_a_file_binds_the_buttons(text, tmp_path):
    file = tmp_path / "pad.yaml"
    file.write_text(text)
    assert read_bindings(file) == JoyBindings(damp_button=3, load_combo_a=(4, 1), load_combo_b=(4, 0))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[1]", "binds no buttons"),
        ("damp_button: 3", "binds no buttons"),
        ("joy:", "binds no buttons"),
        ("joy: {damp: 1}", "damp"),
        ("joy: {damp_button: x}", "joy: damp_button: is 'x', expected `int`"),
        ("joy: {damp_button: -1}", r"damp_button: is \(-1,\)"),
        ("joy: {damp_button: 8}", "8 buttons"),
    ],
)
def test_a_file_that_is_no_layout_is_refused(text, named, tmp_path):
    file = tmp_path / "pad.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=rf"pad\.yaml: .*{named}"):
        read_bindings(file)
