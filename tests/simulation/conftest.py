"""Small robots, written as a description and an MJCF into the test's folder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from humanoid_sim.robots.description import RobotDescription, load_robot

RobotFactory = Callable[..., RobotDescription]

PENDULUM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="base">
      <site name="imu"/>
      <body name="upper">
        <joint name="shoulder" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1" contype="0" conaffinity="0"/>
        <body name="lower" pos="0 0 -0.3">
          <joint name="elbow" axis="0 1 0" armature="0.01"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5" contype="0" conaffinity="0"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

HOPPER = """
<mujoco model="hopper">
  <compiler angle="radian"/>
  <option timestep="0.004" cone="elliptic" impratio="10" iterations="30" ls_iterations="15" integrator="implicitfast"/>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 0.05"/>
    <body name="trunk" pos="0.2 0 1">
      <freejoint/>
      <geom type="box" size="0.1 0.1 0.1" mass="4"/>
      <site name="my_imu" pos="0.05 0 0.02" quat="0.8 0.2 0.4 0.4"/>
      <body name="thigh" pos="0 0 -0.1">
        <joint name="hip" axis="0 1 0" range="-1 1" armature="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03" mass="1" contype="0" conaffinity="0"/>
        <body name="shank" pos="0 0 -0.2">
          <joint name="knee" axis="0 1 0" range="0.2 2" armature="0.02"/>
          <joint name="spring" type="slide" axis="0 0 1" stiffness="5000" damping="50"/>
          <geom name="foot" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03" mass="0.5"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="knee" kp="100" forcerange="-30 40"/>
    <motor name="hip" joint="hip" gear="5" ctrlrange="-4 4"/>
  </actuator>
  <sensor>
    <gyro site="my_imu"/>
    <jointpos joint="hip"/>
    <actuatorpos actuator="hip"/>
  </sensor>
  <keyframe><key qpos="0 0 2 1 0 0 0 0.5 0.5 0"/></keyframe>
</mujoco>
"""
"""A box on one leg, with a sprung foot; its actuators are not in the order of its joints."""


@pytest.fixture
def small_robot(tmp_path: Path) -> RobotFactory:
    """Writes and loads a robot: `small_robot(mjcf, joints=("shoulder", "elbow"), imu="imu", **fields)`."""

    def make(mjcf: str = PENDULUM, joints: tuple[str, ...] = ("shoulder", "elbow"), **fields: Any) -> RobotDescription:
        n = len(joints)
        standby = {
            "target_stiffness": [20.0] * n,
            "target_damping": [1.0] * n,
            "segment_durations": [1.0],
            "pose_segments": [[0.0] * n],
        }
        joint = {"lower": -3.0, "upper": 3.0, "effort_limit": 5.0, "stiffness": 20.0, "damping": 1.0}
        document: dict[str, Any] = {
            "name": "small",
            "mjcf": "small.xml",
            "joints": [{"name": name, **joint} for name in joints],
            "initial_position": [0.0] * n,
            "imu": "imu",
            "simulation": {"physics_timestep": 0.001, "control_frequency": 200},
            "standby_controller_a": standby,
            "standby_controller_b": standby,
            "remote_policy_controller": {"damping_scalar": 1.0},
        }
        document.update(fields)
        (tmp_path / "small.xml").write_text(mjcf)
        (tmp_path / "small.yaml").write_text(yaml.safe_dump(document))
        return load_robot(tmp_path / "small.yaml")

    return make


@pytest.fixture
def hopper(tmp_path: Path) -> Path:
    """The hopper's MJCF, as a user would bring it: no description beside it."""
    path = tmp_path / "hopper.xml"
    path.write_text(HOPPER)
    return path
