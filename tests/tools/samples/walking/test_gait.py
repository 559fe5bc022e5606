import mujoco
import numpy as np

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model, joint_addresses
from tools.samples.walking.gait import (
    ACTION_MIRROR,
    ACTIONS,
    ANSWERS,
    COMMAND,
    OBSERVATION_MIRROR,
    OBSERVATIONS,
    PHASE,
    RATES,
    SIDESTEP,
    STRIDE,
    TURN,
    awake,
    from_canonical,
    gait,
    network_input,
    to_canonical,
)


def test_the_mirror_of_the_mirror_is_the_original():
    for source, sign in (ACTION_MIRROR, OBSERVATION_MIRROR):
        values = np.random.default_rng(0).normal(size=len(source)).astype(np.float32)
        once = values[source] * sign
        assert not np.array_equal(once, values)
        np.testing.assert_array_equal(once[source] * sign, values)


def test_mirrored_joints_put_the_feet_where_a_mirror_shows_them():
    robot = load_robot("lite_biped")
    model = build_model(robot, scene=False)
    data, joints = mujoco.MjData(model), joint_addresses(model, robot.joint_names)
    source, sign = ACTION_MIRROR

    def feet(position):
        data.qpos[joints.qpos] = position
        mujoco.mj_kinematics(model, data)
        return data.body("left_foot").xpos.copy(), data.body("right_foot").xpos.copy()

    rng = np.random.default_rng(1)
    for _ in range(10):
        position = np.array(robot.initial_position) + 0.3 * rng.normal(size=14)
        left, right = feet(position)
        mirrored_left, mirrored_right = feet(position[source] * sign)
        np.testing.assert_allclose(mirrored_left, right * [1.0, -1.0, 1.0], atol=1e-3)
        np.testing.assert_allclose(mirrored_right, left * [1.0, -1.0, 1.0], atol=1e-3)


def test_the_network_sees_a_left_leg_that_swings():
    observations = np.random.default_rng(2).normal(size=(50, OBSERVATIONS)).astype(np.float32)
    seen, mirrored = to_canonical(observations)
    assert 10 < int(mirrored.sum()) < 40
    assert (seen[:, PHASE] >= 0.0).all()
    np.testing.assert_array_equal(seen[~mirrored], observations[~mirrored])
    actions = np.random.default_rng(3).normal(size=(50, 14)).astype(np.float32)
    np.testing.assert_array_equal(from_canonical(from_canonical(actions, mirrored), mirrored), actions)


NOTHING = np.zeros(ANSWERS, dtype=np.float32)


def observed(phase, command=(0.0, 0.0, 0.0)):
    observation = np.zeros(OBSERVATIONS, dtype=np.float32)
    observation[COMMAND : COMMAND + 3] = command
    observation[PHASE : PHASE + 2] = np.sin(phase), np.cos(phase)
    return observation


def test_the_gait_lifts_the_left_foot_in_mid_swing_and_rests_while_standing():
    assert not gait(np.zeros(OBSERVATIONS, dtype=np.float32), NOTHING).any()
    lift = 0.25 * gait(observed(np.pi / 2), NOTHING)
    np.testing.assert_allclose(lift[[0, 3, 5]], [-0.25, 0.5, -0.25], atol=1e-6)
    assert not lift[[7, 10, 12]].any()
    stride = 0.25 * gait(observed(0.0, (0.5, 0.0, 0.0)), NOTHING)
    np.testing.assert_allclose(stride[[0, 7]], [0.215 - 0.05, -0.215 - 0.05], atol=1e-6)  # behind, in front; and a lean


def test_a_robot_that_stands_sees_the_clock_as_far_as_its_base_moves():
    def stirred(speed, command=(0.0, 0.0, 0.0)):
        """Share of the clock that is seen by a robot whose legs turn forward about their ankles."""
        observation = observed(np.pi / 3, command)
        observation[RATES + 3 : RATES + 18 : 7] = 0.05 * speed / 0.34  # both knees
        seen = awake(observation)
        np.testing.assert_array_equal(seen[:PHASE], observation[:PHASE])
        np.testing.assert_allclose(seen[PHASE:] / observation[PHASE:], share := seen[PHASE] / observation[PHASE])
        return float(share)

    assert [stirred(speed) for speed in (0.0, 0.11, 0.23, 0.5)] == [0.0, 0.0, 1.0, 1.0]
    np.testing.assert_allclose(stirred(0.17), 0.5, atol=1e-5)
    np.testing.assert_allclose(stirred(-0.15), 0.3, atol=1e-5)
    assert [stirred(0.0, (vx, 0.0, 0.0)) for vx in (0.04, 0.06, -0.3)] == [0.0, 1.0, 1.0]


def test_the_network_sizes_and_aims_the_gait():
    answer = NOTHING.copy()
    answer[ACTIONS] = -0.25
    lift = 0.25 * gait(observed(np.pi / 2), answer)
    np.testing.assert_allclose(lift[[0, 3, 5]], [-0.125, 0.25, -0.125], atol=1e-6)
    answer[ACTIONS] = -1.0
    assert not gait(observed(np.pi / 2), answer).any()
    for i, step in enumerate((STRIDE, SIDESTEP, TURN)):
        answer = NOTHING.copy()
        answer[ACTIONS + 1 + i] = 0.2
        further = gait(observed(0.0, (0.3, 0.1, -0.1)), answer) - gait(observed(0.0, (0.3, 0.1, -0.1)), NOTHING)
        np.testing.assert_allclose(further, 0.2 * step, atol=1e-6)


def test_a_leg_that_stands_measures_the_velocity_of_the_base():
    """Against MuJoCo: how fast the right foot moves under a base that only turns."""
    robot = load_robot("lite_biped")
    model = build_model(robot, scene=False)
    data, joints = mujoco.MjData(model), joint_addresses(model, robot.joint_names)
    data.qpos[joints.qpos] = robot.initial_position
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(4)
    for _ in range(20):
        turning, rates = rng.normal(0.0, 0.5, 3), rng.normal(0.0, 0.5, 14)
        turning[2], rates[[9, 11]] = 0.0, 0.0  # nothing turns about the vertical
        data.qvel[:] = 0.0
        data.qvel[3:6], data.qvel[joints.dof] = turning, rates
        mujoco.mj_fwdVelocity(model, data)
        expected = []
        for body, axis in (("right_ankle_pitch", 0), ("right_foot", 1)):
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body(body).id, velocity, 0)
            expected.append(-velocity[3 + axis])
        observation = observed(np.pi)
        observation[:3], observation[RATES : RATES + 14] = 0.25 * turning, 0.05 * rates
        seen = network_input(observation)
        np.testing.assert_array_equal(seen[:OBSERVATIONS], observation)
        np.testing.assert_allclose(seen[OBSERVATIONS:] / 2.0, expected, atol=0.15)
