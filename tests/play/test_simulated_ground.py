"""A robot that falls, and a policy that observes the ground: what a run says of it, and a recording that replays."""

from dataclasses import replace

import numpy as np
import pytest
from models import contract_of, linear_model, saved

from humanoid_sim.assets import policy_path
from humanoid_sim.controllers.contract import HeightScan, Term
from humanoid_sim.messages import EventKind, Mode
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.readers.own import STAMP_KEY, encode, write_metadata
from humanoid_sim.replay import main as replay

WALKER = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <geom type="plane" size="0 0 0.05"/>
    <body name="base" pos="0 0 0.1">
      <freejoint/>
      <site name="imu" pos="0 0 0.8"/>
      <geom type="box" size="0.1 0.15 0.2" pos="0 0 0.8" mass="5"/>
      <body name="leg" pos="0 0 0.6">
        <joint name="hip" axis="0 1 0" range="-2 2" armature="0.02"/>
        <geom type="box" size="0.2 0.2 0.29" pos="0 0 -0.3" mass="5"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(("hip", "falls"), [(0.0, False), (1.6, True)])
def test_a_fall_is_an_event_of_the_recording(hip, falls, run, folder):
    (folder / "walker.xml").write_text(WALKER)
    contract = contract_of(("hip",), joint_stiffness=60.0, joint_damping=6.0, observation=("projected_gravity",))
    upright = np.array([[0.0], [0.0], [-hip]], dtype=np.float32)
    saved(folder / "p.onnx", linear_model(write_metadata(contract), matrix=upright))
    script = "damp; load_a; wait; start_locomotion; hold 2.5; damp"
    result = run("--policy", "p.onnx", "--robot", "walker.xml", "--script", script)
    base, seen = result.summary["base"], [event for event in result.events if event.kind is EventKind.FALL]
    assert result.status == falls, result.err
    assert ("the robot fell" in result.out) == falls
    assert [event.text for event in seen] == [base["fell"]] * falls
    for event in seen:
        assert event.time == pytest.approx(base["released"] + base["fall"], abs=1e-9)
        assert replay([str(folder / "r.mcap")]) == 0


SCAN = Term("height_scan", scan=HeightScan(grid=(0.4, 0.2), resolution=0.2), scale=0.5)


def seeing(path):
    """A policy with the sample policy's wiring that observes the ground alone."""
    sample = load_checkpoint(policy_path("lite_tracking")).contract
    contract = replace(sample, task_type="locomotion", observation=(SCAN,), body_names=())
    metadata = {**write_metadata(contract), STAMP_KEY: encode(contract)}
    width = contract_layout(contract).width
    return saved(path, linear_model(metadata, inputs=width, outputs=contract.action_count))


def test_a_policy_observes_the_ground(run, quick, folder):
    policy = seeing(folder / "seeing.onnx")
    script = "damp; load_a; wait; start_locomotion; hold 0.1; damp"
    result = run("--robot", quick, "--policy", str(policy), "--script", script, "--html", "none")
    assert result.status == 0, result.err
    walking = [tick for tick in result.ticks if tick.output.control_mode.mode is Mode.LOCOMOTION]
    assert walking
    for tick in walking:
        scan = tick.input.state.extern["height_scan"]
        assert scan.value.shape == (6,)
        assert scan.arrival_time == tick.input.state.time
        step = tick.output.policy_step
        if step is not None:
            np.testing.assert_array_equal(step.observation, (0.5 * scan.value).astype(np.float32))
    heights = np.array([tick.input.state.extern["height_scan"].value for tick in walking])
    assert 0.3 < heights.min() <= heights.max() < 1.0
    assert replay(["r.mcap"]) == 0
