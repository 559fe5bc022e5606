from dataclasses import replace

import numpy as np
import pytest
from motion_samples import FPS, joint_path, lite, state_of

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.conventions import Conventions, NamedMotion, interpret
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source import SourceMotion
from humanoid_sim.prepare.verify import Tolerance, Verifier, check_rate
from humanoid_sim.robots.description import load_robot
from humanoid_sim.training.motions import BODIES

TOLERANCE = Tolerance(0.01, np.radians(2.0))


@pytest.fixture(scope="module")
def skeleton() -> Skeleton:
    return Skeleton(lite())


@pytest.fixture(scope="module")
def verifier(skeleton: Skeleton) -> Verifier:
    return Verifier(lite(), skeleton)


def named(skeleton: Skeleton, bodies: tuple[str, ...]) -> NamedMotion:
    state = state_of(joint_path(), bodies)
    source = SourceMotion(
        source="dance.npz",
        kind="npz",
        fps=FPS,
        joint_position=state["joint_pos"],
        joint_velocity=state["joint_vel"],
        body_position=state["body_pos_w"],
        body_quaternion=state["body_quat_w"],
    )
    return interpret(source, Conventions(skeleton.joints, bodies, "wxyz"), skeleton)


@pytest.mark.parametrize("bodies", [("chest", *BODIES), BODIES])
def test_the_robots_own_motion_fits_wherever_its_base_is(
    skeleton: Skeleton, verifier: Verifier, bodies: tuple[str, ...]
) -> None:
    checks = verifier.check(named(skeleton, bodies), TOLERANCE)
    assert [check.name for check in checks] == list(bodies)
    assert max(check.position_max for check in checks) < 1e-5
    assert max(check.angle_max for check in checks) < 1e-5


def test_an_error_is_measured_and_placed(skeleton: Skeleton, verifier: Verifier) -> None:
    motion = named(skeleton, ("chest", *BODIES))
    assert motion.body_position is not None
    moved = motion.body_position.copy()
    moved[17, 2] += [0.0, 0.03, 0.04]
    checks = verifier.check(replace(motion, body_position=moved), TOLERANCE)
    hand = checks[2]
    assert (hand.name, hand.worst_frame) == ("left_hand", 17)
    assert hand.position_max == pytest.approx(0.05, abs=1e-5)
    assert hand.position_rms == pytest.approx(0.05 / np.sqrt(40), abs=1e-5)
    assert hand.excess(TOLERANCE) == pytest.approx(5.0, abs=1e-2)
    assert checks[1].excess(TOLERANCE) < 0.01


def test_nothing_to_compare(skeleton: Skeleton, verifier: Verifier) -> None:
    motion = named(skeleton, BODIES)
    assert verifier.check(replace(motion, joint_position=None), TOLERANCE) == ()
    assert verifier.check(replace(motion, body_position=None), TOLERANCE) == ()


def test_a_floating_robot_needs_its_base() -> None:
    biped = load_robot("lite_biped")
    skeleton = Skeleton(biped)
    motion = NamedMotion(
        fps=50.0,
        joint_position=np.zeros((3, biped.joint_count)),
        joint_velocity=None,
        body_names=(skeleton.bodies[1],),
        body_position=np.zeros((3, 1, 3)),
        body_quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1)),
        base_position=None,
        base_quaternion=None,
        is_world=True,
    )
    with pytest.raises(InputError, match=f"no pose of '{skeleton.base}', the floating base of 'lite_biped'"):
        Verifier(biped, skeleton).check(motion, TOLERANCE)


def test_the_rate_that_velocities_fit() -> None:
    q = joint_path()
    rate = np.gradient(q, 1.0 / FPS, axis=0)
    found = check_rate(q, rate, 30.0)
    assert found is not None
    assert found.fps == pytest.approx(50.0)
    assert found.correlation == pytest.approx(1.0)
    shuffled = check_rate(q, rate[:, ::-1], 50.0)
    assert shuffled is not None
    assert shuffled.correlation < 0.5


def test_a_motion_too_short_or_too_still_says_nothing_about_its_rate() -> None:
    q = joint_path()
    assert check_rate(q[:4], q[:4], 50.0) is None
    assert check_rate(np.zeros_like(q), q, 50.0) is None
