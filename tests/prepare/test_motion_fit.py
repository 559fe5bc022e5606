from dataclasses import replace

import numpy as np
import pytest
from motion_samples import BODIES, joint_path, lite, motion_of

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.motion_fit import Tolerance, check_bodies, is_upside_down, worst_excess
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion
from humanoid_sim.robots.description import load_robot

TOLERANCE = Tolerance(0.01, np.radians(2.0))


@pytest.fixture(scope="module")
def skeleton():
    return Skeleton(lite())


@pytest.mark.parametrize("bodies", [("chest", *BODIES), BODIES])
def test_the_robots_own_motion_fits_wherever_its_base_is(skeleton, bodies):
    checks = check_bodies(motion_of(bodies), skeleton, TOLERANCE)
    assert [check.name for check in checks] == list(bodies)
    assert max(check.position_max for check in checks) < 1e-5
    assert max(check.angle_max for check in checks) < 1e-5


def test_an_error_is_measured_and_placed(skeleton):
    motion = motion_of(("chest", *BODIES))
    moved = motion.body_position.copy()
    moved[17, 2] += [0.0, 0.03, 0.04]
    checks = check_bodies(replace(motion, body_position=moved), skeleton, TOLERANCE)
    hand = checks[2]
    assert (hand.name, hand.worst_frame) == ("left_hand", 17)
    assert hand.position_max == pytest.approx(0.05, abs=1e-5)
    assert hand.position_rms == pytest.approx(0.05 / np.sqrt(40), abs=1e-5)
    assert hand.excess(TOLERANCE) == pytest.approx(5.0, abs=1e-2)
    assert checks[1].excess(TOLERANCE) < 0.01


def test_nothing_to_compare(skeleton):
    motion = motion_of(BODIES)
    assert check_bodies(replace(motion, joint_position=None), skeleton, TOLERANCE) == ()
    assert check_bodies(replace(motion, body_position=None), skeleton, TOLERANCE) == ()


def test_a_floating_robot_needs_its_base():
    biped = load_robot("lite_biped")
    skeleton = Skeleton(biped)
    motion = SourceMotion(
        source="walk.npz",
        kind="npz",
        fps=50.0,
        joint_position=np.zeros((3, biped.joint_count)),
        body_names=(skeleton.bodies[1],),
        body_position=np.zeros((3, 1, 3)),
        body_quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1)),
    )
    with pytest.raises(InputError, match=f"no pose of '{skeleton.base}', the floating base of 'lite_biped'"):
        check_bodies(motion, skeleton, TOLERANCE)


def joints_alone(**changes):
    fields = {"source": "a.csv", "kind": "csv", "fps": 50.0, "joint_position": joint_path()}
    return SourceMotion(**fields | changes)


def test_limits():
    assert worst_excess(joint_path(), lite()) is None


def test_which_way_is_up():
    turned = np.tile([1.0, 0.0, 0.0, 0.0], (40, 1))  # upright as w x y z, on its head as x y z w
    source = joints_alone(base_position=np.zeros((40, 3)), base_quaternion=turned, quaternion_order="xyzw")
    assert is_upside_down(source)
    assert not is_upside_down(replace(source, quaternion_order="wxyz"))
    assert not is_upside_down(joints_alone())
    lying = replace(source, base_quaternion=np.tile([0.5, 0.5, 0.5, 0.5], (40, 1)))
    assert not is_upside_down(lying)
