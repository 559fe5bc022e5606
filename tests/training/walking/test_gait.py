import mujoco
import numpy as np

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.training.walking.gait import (
    ACTION_MIRROR,
    OBSERVATION_MIRROR,
    OBSERVATIONS,
    PHASE,
    from_canonical,
    gait,
    to_canonical,
)


def test_the_mirror_of_the_mirror_is_the_original() -> None:
    for source, sign in (ACTION_MIRROR, OBSERVATION_MIRROR):
        values = np.random.default_rng(0).normal(size=len(source)).astype(np.float32)
        once = values[source] * sign
        assert not np.array_equal(once, values)
        np.testing.assert_array_equal(once[source] * sign, values)


def test_mirrored_joints_put_the_feet_where_a_mirror_shows_them() -> None:
    robot = load_robot("lite_biped")
    model = build_model(robot, scene=False)
    data, joints = mujoco.MjData(model), joint_addresses(model, robot.joint_names)
    source, sign = ACTION_MIRROR

    def feet(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def test_the_network_sees_a_left_leg_that_swings() -> None:
    observations = np.random.default_rng(2).normal(size=(50, OBSERVATIONS)).astype(np.float32)
    seen, mirrored = to_canonical(observations)
    assert 10 < int(mirrored.sum()) < 40
    assert (seen[:, PHASE] >= 0.0).all()
    np.testing.assert_array_equal(seen[~mirrored], observations[~mirrored])
    actions = np.random.default_rng(3).normal(size=(50, 14)).astype(np.float32)
    np.testing.assert_array_equal(from_canonical(from_canonical(actions, mirrored), mirrored), actions)


def test_the_gait_lifts_the_left_foot_in_mid_swing_and_rests_while_standing() -> None:
    observation = np.zeros(OBSERVATIONS, dtype=np.float32)
    assert not gait(observation).any()
    observation[PHASE] = 1.0
    lift = 0.25 * gait(observation)
    np.testing.assert_allclose(lift[[0, 3, 5]], [-0.25, 0.5, -0.25], atol=1e-6)
    assert not lift[[7, 10, 12]].any()
    observation[PHASE : PHASE + 2], observation[6] = (0.0, 1.0), 0.5
    stride = 0.25 * gait(observation)
    np.testing.assert_allclose(stride[[0, 7]], [0.215 - 0.05, -0.215 - 0.05], atol=1e-6)  # behind, in front; and a lean
