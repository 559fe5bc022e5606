"""A piano policy on mock motors: it observes the keys that its fingers press."""

import json

import numpy as np
import pytest
from two_keys import two_key_policy

from humanoid_sim import record, replay
from humanoid_sim.cli import run_program
from humanoid_sim.messages import Mode
from humanoid_sim.policy.motion import Motion, motion_bytes

KEY = 34
"""One of the two that the policy knows."""


@pytest.mark.soak
def test_a_policy_hears_the_keys_that_it_presses_on_emulated_motors(run, make_robot, folder, capfd):
    song = np.zeros((200, 88), dtype=np.float32)
    song[50:, KEY] = 1.0
    (folder / "song.mcap").write_bytes(motion_bytes(Motion(song, (), 0.02, task_type="piano")))
    walk = "hold 0.3; damp; hold 0.1; load_a; wait; hold 0.5; start_locomotion; hold 3; damp; hold 0.1"
    options = ("--policy", str(two_key_policy(folder / "two.onnx")), "--motion", "song.mcap", "--script", walk)
    result = run("--robot", make_robot("lite_piano"), "--hardware", "virtual:piano", "--allow-script", *options)
    assert (result.status, result.err) == (0, "")
    assert result.modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    driven = [tick for tick in result.ticks if tick.output.control_mode.mode is Mode.LOCOMOTION]
    assert driven[-1].input.state.extern["key_pressed"].value.nonzero()[0].tolist() == [KEY]
    steps = [tick.output.policy_step for tick in driven if tick.output.policy_step is not None]
    assert steps[-1].observation[88 + KEY] == 1.0
    assert run_program(replay.main, ["r.mcap"]) == 0
    capfd.readouterr()
    assert run_program(record.main, ["info", "r.mcap", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["piano"]["f1"] > 0.8
