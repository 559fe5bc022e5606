"""Motions of bodies alone, and of joints alone."""

import numpy as np
import pytest
from motion_samples import BODIES, joint_path, lite

from humanoid_sim.assets import asset_path
from humanoid_sim.controllers.rotation import quaternion_from_matrix
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import read_contract
from humanoid_sim.prepare.acceptance import INVERSE, accept
from humanoid_sim.prepare.conventions import Conventions
from humanoid_sim.prepare.motion_fit import Tolerance
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion
from humanoid_sim.simulation.kinematics import ForwardKinematics

SKELETON = Skeleton(lite())
TOLERANCE = Tolerance(0.01, np.radians(2.0))


@pytest.fixture(scope="module")
def contract():
    return read_contract(asset_path("policies", "lite_tracking.onnx"))


def bodies_alone(order=(0, 1, 2, 3), **changes):
    position, rotation = ForwardKinematics(lite(), BODIES)(joint_path(300))
    fields = {
        "source": "dances episode 0",
        "kind": "lerobot",
        "fps": 50.0,
        "body_position": position[:, order],
        "body_quaternion": quaternion_from_matrix(rotation)[:, order],
        "frame": "base",
    }
    return SourceMotion(**fields | changes)


def found(source, contract):
    joints = () if source.joint_position is None else SKELETON.joints
    bodies = () if source.body_position is None else BODIES
    conventions = Conventions(joints, bodies, source.quaternion_order)
    return accept(source, conventions, Skeleton(lite(), contract), TOLERANCE)


def test_bodies_that_the_robot_can_reach(contract):
    findings = found(bodies_alone(), contract)
    assert findings.method == INVERSE
    assert [check.name for check in findings.bodies] == list(BODIES)
    assert max(check.position_max for check in findings.bodies) < 0.003
    assert max(check.worst_frame for check in findings.bodies) < 300


@pytest.mark.parametrize("order", [(2, 3, 0, 1)])
def test_bodies_in_each_others_place_cannot_be_reached(contract, order):
    with pytest.raises(InputError, match="no pose of the robot that was found puts body"):
        found(bodies_alone(order), contract)


def test_bodies_in_the_world_without_joints(contract):
    with pytest.raises(
        InputError, match="can only be verified from positions and orientations in the robot's base frame"
    ):
        found(bodies_alone(frame="world"), contract)


def joints_alone(**changes):
    fields = {"source": "a.csv", "kind": "csv", "fps": 50.0, "joint_position": joint_path()}
    return SourceMotion(**fields | changes)


def test_joints_alone_are_not_called_verified(contract):
    findings = found(joints_alone(), contract)
    assert (findings.method, findings.bodies, findings.beyond_limits) == ("", (), None)
    assert "could not be verified" in findings.notes[0]


def test_a_little_beyond_a_limit_is_noted(contract):
    path = joint_path()
    path[7, 3] = lite().upper[3] + 0.01
    findings = found(joints_alone(joint_position=path), contract)
    assert (findings.beyond_limits.joint, findings.beyond_limits.frame) == (SKELETON.joints[3], 7)
    assert findings.beyond_limits.excess == pytest.approx(0.01)
    assert "joint left_elbow_pitch is at" in findings.notes[1]
    path[7, 3] += 0.1
    with pytest.raises(InputError, match=r"joint 'left_elbow_pitch' is at .* in frame 7, beyond its limits"):
        found(joints_alone(joint_position=path), contract)
