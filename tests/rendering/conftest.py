"""Ticks without a robot, and a small model whose pictures are easy to predict."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState

PENDULUM = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1" pos="0 0 -1" rgba="0.7 0.7 0.7 1"/>
    <body>
      <joint name="hinge" axis="1 0 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.6" size="0.08" rgba="0.9 0.2 0.2 1"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def pendulum():
    return mujoco.MjModel.from_xml_string(PENDULUM)


@pytest.fixture
def make_tick():
    def make(index, time, qpos, mode=Mode.STANDBY, message=""):
        output = TickOutput(MITCommand.zeros(1), ControlMode(mode, "standby_controller_a", message))
        pose = None if qpos is None else np.asarray(qpos, dtype=np.float64)
        return TickRecord(index, TickInput(MITState.unknown(1, time)), output, 0.001, False, pose)

    return make
