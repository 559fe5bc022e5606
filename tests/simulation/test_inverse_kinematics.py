import numpy as np

from humanoid_sim.controllers.rotation import rotation_angle
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.inverse_kinematics import InverseKinematics
from humanoid_sim.simulation.kinematics import ForwardKinematics
from tools.samples.motions import BODIES, pose_a, sample_motion


def test_the_joints_of_a_sample_motion_are_found_from_its_bodies():
    lite = load_robot("lite")
    _, path = sample_motion(lite, "reach")
    path = path[:120]
    position, rotation = ForwardKinematics(lite, BODIES)(path)
    solution = InverseKinematics(lite, BODIES, damping=1e-3).solve_path(position, rotation, pose_a(lite))
    np.testing.assert_allclose(solution, path, atol=1e-4)


def test_a_pose_out_of_reach_gives_joints_within_limits():
    lite = load_robot("lite")
    position, rotation = ForwardKinematics(lite)(pose_a(lite))
    solution = InverseKinematics(lite, lite.hands).solve(position + np.array([0.0, 0.0, 5.0]), rotation, pose_a(lite))
    assert np.isfinite(solution).all()
    assert (solution >= lite.lower).all()
    assert (solution <= lite.upper).all()


def test_hands_alone_leave_the_elbows_to_the_posture():
    lite = load_robot("lite")
    kinematics = ForwardKinematics(lite)
    position, rotation = kinematics(pose_a(lite))
    target = position + np.array([0.05, 0.0, 0.05])
    solver = InverseKinematics(lite, lite.hands)
    solution = solver.solve(target, rotation, pose_a(lite), posture=pose_a(lite), iterations=100)
    reached, turned = kinematics(solution)
    np.testing.assert_allclose(reached, target, atol=1e-3)
    assert rotation_angle(turned, rotation).max() < 5e-3
