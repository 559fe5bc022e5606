"""What a run says of a robot that falls, or does not, whose base frame lies at the ground."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.messages import Event, EventKind
from humanoid_sim.recording.reader import open_recording
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
        <body name="weight"><joint name="swing" axis="0 1 0" range="-3 3" armature="0.02"/>
          <geom type="box" size="0.05 0.05 0.05" pos="0 0.3 0" mass="1"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
SCRIPT = "damp; load_a; wait; start_locomotion; hold {}; damp"
CONTRACT = """
task_type: locomotion
joint_names: [hip, swing]
observation: [base_ang_vel, projected_gravity, velocity_commands, joint_pos, joint_vel, actions]
default_joint_pos: [0, 0]
joint_stiffness: [60, 20]
joint_damping: [6, 1]
action_scale: 1.0
policy_dt: 0.02
"""


def save_constant(path, action, width):
    """A policy that gives the same answer whatever it sees."""
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["obs", "weight", "bias"], ["action"])],
        "constant",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, width])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, len(action)])],
        [
            numpy_helper.from_array(np.zeros((width, len(action)), dtype=np.float32), "weight"),
            numpy_helper.from_array(np.array(action, dtype=np.float32), "bias"),
        ],
    )
    model = helper.make_model(graph, ir_version=8, opset_imports=[helper.make_opsetid("", 17)])
    onnx.save(model, str(path))


def write(folder, action):
    """The robot, and a policy that gives the same answer whatever it sees."""
    (folder / "walker.xml").write_text(WALKER)
    (folder / "contract.yaml").write_text(CONTRACT)
    save_constant(folder / "p.onnx", action, width=15)
    return "--policy", "p.onnx", "--robot", "walker.xml"


def test_a_robot_stands_whose_base_frame_lies_at_the_ground(run, folder):
    result = run(*write(folder, (0.0, 0.0)), "--script", SCRIPT.format(2.5))
    assert result.status == 0, result.err
    base = result.summary["base"]
    assert (base["fall"], base["fell"]) == (None, "")
    assert "the robot fell" not in result.out
    off = "guards: following is off for 2 of 2 joints"
    assert " ".join(result.out.split()).count(off) == 1


def test_a_fall_is_an_event_of_the_recording(run, folder):
    result = run(*write(folder, (1.6, 0.0)), "--script", SCRIPT.format(3))
    base = result.summary["base"]
    recording = open_recording(folder / "r.mcap")
    (fall,) = [item for item in recording.entries() if isinstance(item, Event) and item.kind is EventKind.FALL]
    assert fall.text == base["fell"]
    assert fall.time == pytest.approx(base["released"] + base["fall"], abs=1e-9)
    assert replay([str(folder / "r.mcap")]) == 0
