"""A small model whose pictures are easy to predict."""

import mujoco

PENDULUM = mujoco.MjModel.from_xml_string("""
<mujoco>
  <visual><quality shadowsize="256"/></visual>
  <worldbody>
    <geom type="plane" size="0 0 1" pos="0 0 -1" rgba="0.7 0.7 0.7 1"/>
    <body>
      <joint name="hinge" axis="1 0 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.6" size="0.08" rgba="0.9 0.2 0.2 1"/>
    </body>
  </worldbody>
</mujoco>
""")
