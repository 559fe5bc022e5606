"""A piano policy on mock motors: it observes the keys that its fingers press."""

import json

import numpy as np
import onnx
import pytest
from models import linear_model
from pressing import KEY, press_in_standby, pressing_pose

from humanoid_sim import record, replay
from humanoid_sim.cli import run_program
from humanoid_sim.messages import Mode
from humanoid_sim.policy.motion import Motion, motion_bytes
from humanoid_sim.robots.description import load_robot

CONTRACT = """
task_type: piano
joint_names: {joints}
observation: [joint_pos, target_keys, key_pressed]
default_joint_pos: {pose}
joint_stiffness: {stiffness}
joint_damping: {damping}
action_scale: 1.0e-6
policy_dt: 0.02
"""
"""Of a policy that holds the pose, whatever it sees."""


def holding(folder):
    """Options of `play` for that policy, and a song that asks for the key all the time."""
    lite = load_robot("lite_piano")
    standby = lite.standby_controller_a
    n = lite.joint_count
    onnx.save(linear_model({}, inputs=n + 2 * 88, outputs=n), str(folder / "piano.onnx"))
    fields = {"joints": lite.joint_names, "pose": pressing_pose()}
    fields |= {"stiffness": standby.target_stiffness, "damping": standby.target_damping}
    texts = {name: json.dumps(list(values)) for name, values in fields.items()}
    (folder / "contract.yaml").write_text(CONTRACT.format(**texts), encoding="utf-8")
    song = np.zeros((200, 88), dtype=np.float32)
    song[:, KEY] = 1.0
    (folder / "song.mcap").write_bytes(motion_bytes(Motion(song, (), 0.02, task_type="piano")))
    return "--policy", str(folder / "piano.onnx"), "--motion", str(folder / "song.mcap")


@pytest.mark.soak
def test_a_policy_hears_the_keys_that_it_presses_on_emulated_motors(run, make_robot, folder, capfd):
    walk = "hold 0.3; damp; hold 0.1; load_a; wait; hold 0.5; start_locomotion; hold 2; damp; hold 0.1"
    robot = make_robot("lite_piano", change=press_in_standby)
    hardware = ("--hardware", "virtual:piano", "--allow-script", "--script", walk)
    result = run("--robot", robot, *holding(folder), *hardware)
    assert (result.status, result.err) == (0, "")
    assert result.modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    driven = [tick for tick in result.ticks if tick.output.control_mode.mode is Mode.LOCOMOTION]
    for tick in driven:
        assert tick.input.state.extern["key_pressed"].value.nonzero()[0].tolist() == [KEY]
    steps = [tick.output.policy_step for tick in driven if tick.output.policy_step is not None]
    assert all(step.observation[14 + 88 + KEY] == 1.0 for step in steps)
    assert run_program(replay.main, ["r.mcap"]) == 0
    capfd.readouterr()
    assert run_program(record.main, ["info", "r.mcap", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["piano"]["f1"] == 1.0
