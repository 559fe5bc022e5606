"""What a run says of a robot that falls, or does not, whose base frame lies at the ground."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.messages import Event, EventKind
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.summary import summarize
from humanoid_sim.replay import main as replay

WALKER = """
<mujoco>
  <compiler angle="radian"/>
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


SQUATTER = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom type="plane" size="0 0 0.05"/>
    <body name="base" pos="0 0 0.85">
      <freejoint/>
      <site name="imu"/>
      <geom type="box" size="0.08 0.12 0.1" mass="8"/>
      <body name="thigh" pos="0 0 -0.1">
        <joint name="hip" axis="0 1 0" range="-2.5 2.5" armature="0.05"/>
        <geom type="box" size="0.03 0.03 0.15" pos="0 0 -0.17" mass="0.3"/>
        <body name="shin" pos="0 0 -0.34">
          <joint name="knee" axis="0 1 0" range="-0.1 2.8" armature="0.05"/>
          <geom type="box" size="0.03 0.03 0.15" pos="0 0 -0.17" mass="0.3"/>
          <body name="foot" pos="0 0 -0.34">
            <joint name="ankle" axis="0 1 0" range="-2 2" armature="0.05"/>
            <geom type="box" size="0.2 0.2 0.03" pos="0 0 -0.03" mass="3"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""Symmetric in hip and ankle, so that its weight stays above its foot however deep it squats."""


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


def squat(folder, default, action):
    """The squatter: its hip bent by `default` in the default pose, and by `action` more under the policy."""
    (folder / "squatter.xml").write_text(SQUATTER)
    (folder / "contract.yaml").write_text(
        CONTRACT.replace("[hip, swing]", "[hip, knee, ankle]")
        .replace("[0, 0]", str([-default, 2.0 * default, -default]))
        .replace("[60, 20]", "300")
        .replace("[6, 1]", "20")
    )
    save_constant(folder / "p.onnx", (-action, 2.0 * action, -action), width=18)
    options = "--physics-timestep", "0.001", "--policy-seconds", "3", "--drop", "0"  # nothing balances it as it lands
    return "--policy", "p.onnx", "--robot", "squatter.xml", *options


def write(folder, action):
    """The robot, and a policy that gives the same answer whatever it sees."""
    (folder / "walker.xml").write_text(WALKER)
    (folder / "contract.yaml").write_text(CONTRACT)
    save_constant(folder / "p.onnx", action, width=15)
    return "--policy", "p.onnx", "--robot", "walker.xml", "--physics-timestep", "0.001"


def test_a_robot_stands_whose_base_frame_lies_at_the_ground(run, folder):
    result = run(*write(folder, (0.0, 0.0)), "--policy-seconds", "2.5")
    assert result.status == 0, result.err
    base = result.summary["base"]
    assert (base["fall"], base["fell"]) == (None, "")
    assert base["duration"] == pytest.approx(2.5, abs=0.03)
    assert base["height"][1] == pytest.approx(0.0, abs=0.02)
    assert base["tilt_max"] < 0.05
    assert "the robot fell" not in result.out
    off = "guards: following is off for 2 of 2 joints, which lack an effort limit of the robot's own"
    assert " ".join(result.out.split()).count(off) == 1


@pytest.mark.parametrize(
    ("default", "action", "lowest", "fell"),
    [
        (1.2, 0.0, (0.9, 1.1), False),  # it walks in a squat: that is how high it stands
        (0.0, 1.35, (0.3, 0.6), True),  # down to where nobody can tell it from a fall
    ],
)
def test_a_low_posture_is_no_fall(run, folder, default, action, lowest, fell):
    base = run(*squat(folder, default, action)).summary["base"]
    assert lowest[0] < base["lowest"] < lowest[1]
    assert (base["fall"] is not None) is fell


def test_a_fall_is_an_event_of_the_recording(run, folder):
    result = run(*write(folder, (1.6, 0.0)), "--policy-seconds", "3")
    base = result.summary["base"]
    recording = open_recording(folder / "r.mcap")
    (fall,) = [item for item in recording.entries() if isinstance(item, Event) and item.kind is EventKind.FALL]
    assert fall.text == base["fell"]
    assert fall.time == pytest.approx(base["released"] + base["fall"], abs=1e-9)
    assert ("fall", fall.text) in [(said.kind, said.text) for said in summarize(recording).remarks]
    assert replay([str(folder / "r.mcap")]) == 0


def test_a_fault_is_not_called_a_fall(run, folder):
    result = run(*write(folder, (float("nan"), 0.0)), "--policy-seconds", "1")
    assert result.status == 1
    assert [fault["message"] for fault in result.summary["faults"]] != []
    assert "fell" not in result.out
    assert result.summary["base"] is None


def test_a_motion_may_be_cut_short_or_held_at_its_end(run, quick):
    short = run("--robot", quick, "--policy-seconds", "0.5")
    assert short.status == 0, short.err
    spans = {span["mode"]: span["end"] - span["start"] for span in short.summary["modes"]}
    assert spans["LOCOMOTION"] == pytest.approx(0.5, abs=0.02)
