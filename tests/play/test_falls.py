"""What a run says of a robot that falls."""

import numpy as np
import pytest
from models import contract_of, linear_model, saved

from humanoid_sim.messages import EventKind
from humanoid_sim.policy.readers.own import write_metadata
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
