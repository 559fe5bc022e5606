"""Small robots, written as a description and an MJCF into the test's folder."""

import pytest
import yaml

from humanoid_sim.robots.description import load_robot

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


@pytest.fixture
def small_robot(tmp_path):
    """Writes and loads a robot: `small_robot(mjcf, joints=("shoulder", "elbow"), imu="imu", **fields)`."""

    def make(mjcf=PENDULUM, joints=("shoulder", "elbow"), **fields):
        n = len(joints)
        standby = {
            "target_stiffness": [20.0] * n,
            "target_damping": [1.0] * n,
            "segment_durations": [1.0],
            "pose_segments": [[0.0] * n],
        }
        joint = {"lower": -3.0, "upper": 3.0, "effort_limit": 5.0, "stiffness": 20.0, "damping": 1.0}
        document = {
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
