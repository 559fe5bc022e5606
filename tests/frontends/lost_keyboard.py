"""A piano policy that hears a MIDI keyboard, and how that is lost: unplugged, or with its program."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
from emulated_keyboard import EmulatedKeyboard, on_fifo
from fates import BLOWS, ROWS, Log, Played
from models import linear_model

from humanoid_sim.messages import Mode
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.policy.motion import Motion, motion_bytes
from humanoid_sim.robots.description import load_robot

LOSSES = ("unplugged", *BLOWS)
KEYS = [39, 43]
"""That are held down."""
TIMEOUT = 0.5
"""s"""
_NOTES = [key + 21 for key in KEYS]
_CONTRACT = """
task_type: piano
joint_names: {joints}
observation: [joint_pos, target_keys, key_pressed]
default_joint_pos: {pose}
joint_stiffness: 50
joint_damping: 2
action_scale: 0.01
policy_dt: 0.02
"""


def piano_options(folder: Path, robot: str = "lite") -> tuple[str, ...]:
    """Options of `play` for a policy that moves with the keys that are down, a song, and the keyboard."""
    description = load_robot(robot)
    pose = list(description.standby_controller_a.pose_segments[-1])
    joints = len(description.joint_names)
    onnx.save(linear_model({}, inputs=joints + 2 * 88, outputs=joints), str(folder / "piano.onnx"))
    text = _CONTRACT.format(joints=json.dumps(description.joint_names), pose=pose)
    (folder / "contract.yaml").write_text(text, encoding="utf-8")
    song = np.zeros((400, 88), dtype=np.float32)
    song[10:, 39] = song[30:, 43] = 1.0
    if not (folder / "song.mcap").exists():
        (folder / "song.mcap").write_bytes(motion_bytes(Motion(song, (), 0.02, task_type="piano")))
    return ("--policy", str(folder / "piano.onnx"), "--motion", str(folder / "song.mcap"), *ROWS["midi"].options)


@contextmanager
def plugged_in(folder: Path) -> Iterator[EmulatedKeyboard]:
    """The keyboard, before `play` looks for it."""
    with on_fifo(folder / "keys") as keyboard:
        yield keyboard


def play_and_lose(play: Played, keyboard: EmulatedKeyboard, mode: Mode, loss: str) -> None:
    """Hold keys down until the policy has heard them, then lose the keyboard in that mode."""
    keyboard.press(*_NOTES)
    play.until_owned(KEY_PRESSED, "midi")
    play.reach(mode)
    if loss == "unplugged":
        keyboard.unplug()
        play.operator.ask("mark blow")
    else:
        play.strike(["midi"], BLOWS[loss])


def down(log: Log, index: int) -> list[int]:
    """The keys that are down in a tick, whether they count still or not."""
    heard = log.ticks[index].input.state.extern.get(KEY_PRESSED)
    return [] if heard is None else [int(key) for key in heard.value.nonzero()[0]]


def check_loss(log: Log, loss: str, period: float) -> float:
    """What must follow in LOCOMOTION; s from the last sample to the tick in which the policy is stopped."""
    fault = next(tick for tick in log.ticks if tick.output.faults)
    assert [one.message for one in fault.output.faults] == [
        "observation key_pressed[0] is nan, expected a finite number: no key state has come, or the last one is too old"
    ]
    control, command = fault.output.control_mode, fault.output.command
    assert (control.mode, control.controller_name) == (Mode.DAMPING, "damping_controller")
    assert not command.stiffness.any(), "in the same tick"
    assert (command.damping > 0.0).all()
    assert down(log, fault.index - 1) == ([] if loss == "unplugged" else KEYS)
    assert any(down(log, index) == KEYS for index in range(fault.index))
    took = float(fault.input.state.time) - fault.input.state.extern[KEY_PRESSED].arrival_time
    assert TIMEOUT < took <= TIMEOUT + 0.02 + period + 1e-3, "it was found in the next step of the policy"
    return took
