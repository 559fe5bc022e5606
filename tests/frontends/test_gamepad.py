"""The gamepad's driver on gamepads that SDL makes, against a session without a loop."""

import threading
import time

import numpy as np
import pytest

pytest.importorskip("pygame", reason="pygame-ce is not installed (extra 'gamepad')")

from virtual_pads import VirtualPad

from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.gamepad.device import Pads
from humanoid_sim.frontends.gamepad.layout import PadLayout, Sticks, chosen_layout, speed_range
from humanoid_sim.gamepad import Driver, GamepadConfig
from humanoid_sim.gamepad import _list as listed
from humanoid_sim.messages import Intent, Mode
from humanoid_sim.session.losses import DeviceWatch

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


def test_damp_wins_over_whatever_else_is_pressed_at_once(local, pads, pad):
    desk = Desk(local, pads)
    desk.look()
    desk.press(pad, "X")
    pad.press("L1", "A", "X")
    desk.look()
    assert desk.mode is Mode.DAMPING


def test_buttons_that_are_down_when_a_pad_is_plugged_in_are_no_press_but_damp_is(local, pads, pad):
    desk = Desk(local, pads)
    local.tick(Intent.DAMP)
    pad.press("L1", "A")
    desk.look()
    assert desk.mode is Mode.DAMPING
    pad.press("X")
    other = Desk(local, pads)
    local.tick(Intent.LOAD_A)
    other.look()
    assert other.mode is Mode.DAMPING


def test_the_session_s_answer_is_told(local, pads, pad):
    desk = Desk(local, pads)
    desk.look()
    done = threading.Event()

    def loop():
        while not done.wait(0.002):
            local.tick()

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        pad.press("R1", "A")
        lines = desk.driver.step(pads.look())
    finally:
        done.set()
        thread.join()
    (line,) = lines
    assert line.endswith("START_LOCOMOTION refused: requires finished STANDBY, mode is ZERO_TORQUE")


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
        assert line.startswith("Odd Pad (4 buttons, unknown layout) is not used: JoyBindings.quit_button: is (6,)")
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


def test_the_list_says_which_pad_cannot_be_used(capsys, pads):
    odd = VirtualPad("Odd Pad", known=False, buttons=8, axes=2)
    try:
        pads.look()
        assert listed(pads, JoyBindings()) == 0
        assert capsys.readouterr().out.startswith("Odd Pad (8 buttons, unknown layout); down: none; its buttons have")
        assert listed(pads, JoyBindings(damp_button=12)) == 1
        assert "cannot be used: JoyBindings.damp_button: is (12,), but the gamepad has" in capsys.readouterr().out
    finally:
        odd.unplug()
        pads.look()


def test_buttons_can_be_bound_anew(local, pads):
    odd = VirtualPad("Odd Pad", known=False, buttons=8, axes=2)
    joy = JoyBindings(damp_button=7, quit_button=6, load_combo_a=(0, 1), load_combo_b=(0, 2))
    try:
        desk = Desk(local, pads, GamepadConfig(joy=joy))
        assert desk.look() == [
            "Odd Pad (8 buttons, unknown layout) drives",
            "its buttons have their driver's numbers: see them with gamepad --list, bind them by --joy.*",
        ]
        for button, mode in ((7, Mode.DAMPING), (0, Mode.DAMPING), (1, Mode.STANDBY)):
            odd.press(button)
            desk.look()
            assert desk.mode is mode
    finally:
        odd.unplug()


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


def test_a_velocity_ends_with_the_gamepad(local, pads, pad):
    desk = Desk(local, pads)
    desk.look()
    pad.push(1, -1.0)
    desk.look(2)
    assert local.velocity.command[0] == pytest.approx(0.8)
    pad.unplug()
    local.time += 0.25
    assert desk.look(1) == ["Test Pad is gone"]
    np.testing.assert_allclose(local.velocity.command, 0.0)


def test_on_hardware_a_gamepad_that_is_unplugged_damps(local, pads, pad):
    desk = Desk(local, pads, hardware=True)
    desk.look()
    local.enter_remote()
    pad.unplug()
    lines = desk.look()
    assert lines[0] == "Test Pad is gone"
    assert desk.mode is Mode.DAMPING


def test_its_heartbeats_keep_the_robot_driven(local, pads, pad):
    desk = Desk(local, pads, hardware=True)
    watch = DeviceWatch("gamepad", lambda: local.data.heartbeats, local.told.append)
    desk.look()
    local.enter_remote()
    desk.look()
    for _ in range(10):
        desk.look()
        desk.look()
        assert watch.poll(local.time, None) == ()
    local.time += 0.2
    assert watch.poll(local.time, None) == (Intent.DAMP,)


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


def test_sticks_that_cannot_work_are_refused():
    with pytest.raises(FieldError, match=r"^dead_zone: is 1.0, expected 0 or more, below 1$"):
        Sticks(dead_zone=1.0)
    with pytest.raises(FieldError, match=r"^axes: are \(-1, 0, 2\), expected indices >= 0$"):
        Sticks(forward_axis=-1)
