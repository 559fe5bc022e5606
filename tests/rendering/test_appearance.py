import mujoco
import numpy as np
import pytest

from humanoid_sim.rendering.appearance import robot_box, tint_limbs

LIMBS = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1" {colour}/>
    <body pos="0 0 1">
      <freejoint/>
      <geom type="box" size="0.1 0.2 0.2" {colour}/>
      <body pos="0 0.2 0"><joint axis="1 0 0" range="-1 1"/><geom name="left" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.05" {colour}/>
        <body pos="0 0 -0.4"><joint axis="1 0 0" range="-1 1"/><geom name="left_end" type="sphere" size="0.06" {colour}/></body></body>
      <body pos="0 -0.2 0"><joint axis="1 0 0" range="-1 1"/><geom name="right" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.05" {colour}/></body>
    </body>
  </worldbody>
</mujoco>
"""  # noqa: E501 - a body a line
GREY = 'rgba="0.5 0.5 0.5 1"'


def test_limbs_of_a_robot_of_one_colour_get_one_each():
    model = mujoco.MjModel.from_xml_string(LIMBS.format(colour=GREY))
    assert tint_limbs(model)
    floor, trunk, left, end, right = (model.geom_rgba[geom, :3].astype(float) for geom in range(5))
    np.testing.assert_allclose(floor, 0.5)
    assert np.ptp(trunk) < 0.06
    assert np.abs(left - right).max() > 0.3
    assert np.abs(left - trunk).max() > 0.2
    # the parts of a limb are told apart by their brightness
    np.testing.assert_allclose(end / end.max(), left / left.max(), atol=0.02)
    assert abs(end.max() - left.max()) > 0.1
    assert not tint_limbs(model), "it has colours now"


def test_colours_that_a_robot_has_are_left_as_they_are():
    text = (
        LIMBS.format(colour=GREY)
        .replace('name="right"', 'name="right" rgba="0.9 0.1 0.1 1"', 1)
        .replace('size="0.05" rgba="0.5 0.5 0.5 1"/></body>\n    </body>', 'size="0.05"/></body>\n    </body>')
    )
    model = mujoco.MjModel.from_xml_string(text)
    before = model.geom_rgba.copy()
    assert not tint_limbs(model)
    np.testing.assert_array_equal(model.geom_rgba, before)


def test_the_box_of_a_robot_that_moves_holds_its_reach_and_a_world_without_one_has_none(pendulum):
    nobody = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    assert robot_box(nobody) is None
    assert not tint_limbs(nobody)
    at_rest = robot_box(pendulum)
    assert at_rest is not None
    np.testing.assert_allclose(at_rest, [[-0.08, -0.08, -0.68], [0.08, 0.08, 0.08]], atol=1e-6)
    swinging = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint axis='1 0 0' range='-90 90'/>"
        "<geom type='capsule' fromto='0 0 0 0 0 -0.6' size='0.08'/></body></worldbody></mujoco>"
    )
    reach = robot_box(swinging, moving=True)
    assert reach[1][1] == pytest.approx(0.68, abs=0.03)
    assert reach[0][1] == pytest.approx(-0.68, abs=0.03)
