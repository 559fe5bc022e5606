import numpy as np
import pytest
from doctor_examples import JOINTS, tracker

from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.doctor.goals import Goal, MotionGoal, Strain, VelocityGoal
from humanoid_sim.mit import ANCHOR_POSE, Extern, MITCommand, MITState
from humanoid_sim.simulation.floating_base import BaseState

DT = 0.02


def turned(angle, axis=(0.0, 0.0, 1.0)):
    return np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * np.array(axis))])


def base(*, height=0.8, yaw=0.0, pitch=0.0, velocity=(0.0, 0.0, 0.0), rate=0.0):
    quaternion = turned(yaw) if pitch == 0.0 else turned(pitch, (0.0, 1.0, 0.0))
    position, turning = np.array([3.0, -1.0, height]), np.array([0.0, 0.0, rate])
    return BaseState(position, quaternion, np.array(velocity), turning, position, np.zeros(()))


def state(position=None, effort=0.0, anchor=None):
    zeros = np.zeros(4)
    live = {} if anchor is None else {"extern": {ANCHOR_POSE: Extern(anchor, 0.0)}}
    return MITState(
        time=0.0,
        joint_position=zeros if position is None else position,
        joint_velocity=zeros,
        joint_effort=np.full(4, effort),
        joint_age=zeros,
        imu_quaternion=turned(0.0),
        imu_angular_velocity=np.zeros(3),
        imu_linear_acceleration=np.zeros(3),
        **live,
    )


@pytest.mark.parametrize(
    ("height", "pitch", "lost"),
    [(0.8, 0.0, ""), (0.5, 0.0, ""), (0.47, 0.0, "fell: its centre of mass sank"), (0.8, 1.1, "fell: tilted by 63°")],
)
def test_a_fall_is_a_tilt_or_a_loss_of_height(height, pitch, lost):
    goal = Goal()
    assert goal.update(0, state(), base()) == ""
    answer = goal.update(1, state(), base(height=height, pitch=pitch))
    assert answer.startswith(lost)
    assert bool(answer) == bool(lost)


def test_a_fixed_base_never_falls():
    assert Goal().update(0, state(), None) == ""


def test_a_walk_is_measured_in_the_heading_frame_once_it_has_settled():
    goal = VelocityGoal(np.array([0.5, 0.0, 0.3]), DT)
    for _ in range(50):  # the first second does not count
        goal.update(0, state(), base(yaw=np.pi / 2))
    for _ in range(50):
        goal.update(0, state(), base(yaw=np.pi / 2, velocity=(0.0, 0.25, 0.0), rate=0.1))
    parts = goal.parts()
    assert parts["velocity"] == pytest.approx(0.25 / 0.2)
    assert parts["turning"] == pytest.approx(0.2 / 0.5)
    assert parts["tilt"] == 0.0
    assert parts["height"] == pytest.approx(0.0, abs=1e-9)


def motion_goal(base_known=True, frames=2):
    joints = np.tile([0.1, 0.2, 0.3, 0.4], (frames, 1))
    poses = {"anchor_pos": np.tile([0.0, 0.0, 0.8], (frames, 1)), "anchor_quat": np.tile(turned(0.5), (frames, 1))}
    reference = MotionReference(frames, {"reference_joint_pos": joints, "reference_joint_vel": joints, **poses})
    return MotionGoal(tracker(), reference, MotionReference(frames, poses) if base_known else None, JOINTS)


def test_a_motion_is_laid_onto_the_robot_where_it_stands():
    goal = motion_goal()
    posed = np.array([0.1, 0.2, 0.3, 0.4])
    for frame in range(2):
        assert goal.update(frame, state(posed), base(yaw=2.0)) == ""
    assert all(part == pytest.approx(0.0, abs=1e-6) for part in goal.parts().values())


def test_errors_of_a_motion_are_means():
    goal = motion_goal()
    goal.update(0, state(np.array([0.1, 0.2, 0.3, 0.4])), base(yaw=2.0))
    goal.update(1, state(np.array([0.3, 0.4, 0.5, 0.6])), base(yaw=2.2, height=0.6))
    parts = goal.parts()
    assert parts["joints"] == pytest.approx(0.5 * 0.2 / 0.1, abs=1e-6)
    assert parts["position"] == pytest.approx(0.5 * 0.2 / 0.3, abs=1e-6)
    assert parts["angle"] == pytest.approx(0.5 * 0.2 / 0.2, abs=1e-6)


@pytest.mark.parametrize(
    ("height", "pitch", "lost"),
    [
        (0.5, 0.0, ""),
        (0.4, 0.0, "strayed: 0.40 m off"),
        (1.2, 0.0, "strayed: 0.40 m off"),
        (0.8, 1.3, "strayed: tilted"),
    ],
)
def test_a_motion_is_lost_by_height_or_tilt(height, pitch, lost):
    goal = motion_goal()
    goal.update(0, state(), base())
    answer = goal.update(1, state(), base(height=height, pitch=pitch))
    assert answer.startswith(lost)
    assert bool(answer) == bool(lost)


def test_a_wrong_heading_alone_is_not_a_loss():
    goal = motion_goal()
    goal.update(0, state(), base(yaw=0.0))
    assert goal.update(1, state(), base(yaw=3.0)) == ""
    assert goal.parts()["angle"] == pytest.approx(0.5 * 3.0 / 0.2, rel=1e-6)


def test_without_a_base_in_the_motion_the_anchor_is_compared():
    goal = motion_goal(base_known=False)
    at = np.array([3.0, -1.0, 0.8])
    goal.update(0, state(anchor=np.concatenate([at, turned(1.0)])), base())
    assert "off the motion's height" in goal.update(
        1, state(anchor=np.concatenate([at + np.array([0.0, 0.0, 0.5]), turned(1.0)])), base()
    )


def test_strain_is_independent_of_the_rate():
    strains = []
    for dt in (0.02, 0.04):
        strain = Strain(dt)
        for step in range(round(4.0 / dt)):  # a ramp of 5 rad/s
            position = np.full(4, 5.0 * step * dt)
            zeros = np.zeros(4)
            strain.update(state(effort=15.0), MITCommand(position, zeros, zeros, zeros, zeros))
        strains.append(strain.parts())
    for parts in strains:
        assert parts["shaking"] == pytest.approx(1.0, abs=0.01)
        assert parts["torque"] == pytest.approx(1.0)
