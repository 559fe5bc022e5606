"""Randomisation that is drawn for every episode, of a single environment and of many: the same of both."""

import gymnasium
import numpy as np
import pytest
from alike import EVERYTHING, PUSHED, both

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.filterwarnings("ignore:.*recommend using a symmetric and normalized space")

LITE, BIPED = "humanoid_sim/LiteTracking-v0", "humanoid_sim/BipedVelocity-v0"
ROBOTS = {LITE: load_robot("lite"), BIPED: load_robot("lite_biped")}


@pytest.mark.parametrize(("name", "options"), [(LITE, EVERYTHING), (BIPED, PUSHED)])
def test_every_step_of_every_episode_is_that_of_single_environments(name, options):
    native, sync = both(name, 2, robot=ROBOTS[name], randomisation=options, actuation="implicit")
    singles = [env.unwrapped for env in sync.envs]
    np.testing.assert_array_equal(native.reset(seed=5)[0], sync.reset(seed=5)[0])
    native.action_space.seed(0)
    masses = []
    for episode in range(3):
        ours, theirs = (native.reset(), sync.reset()) if episode else (native.reset(seed=5), sync.reset(seed=5))
        np.testing.assert_array_equal(ours[0], theirs[0])
        for _ in range(6):
            action = 0.2 * native.action_space.sample()
            mine, others = native.step(action), sync.step(action)
            np.testing.assert_allclose(mine[0], others[0], rtol=0, atol=1e-9)
            np.testing.assert_allclose(mine[1], others[1], rtol=0, atol=1e-9)
            np.testing.assert_array_equal(mine[2], others[2])
            for i, single in enumerate(singles):
                np.testing.assert_allclose(native.simulation.qpos[i], single.robot.qpos, rtol=0, atol=1e-9)
                np.testing.assert_allclose(native.simulation.qvel[i], single.robot.data.qvel, rtol=0, atol=1e-9)
        masses.append([native.simulation.model(i).body_mass.sum() for i in range(2)])
        assert masses[-1] == [single.robot.model.body_mass.sum() for single in singles]
    assert len({*masses[0], *masses[1], *masses[2]}) == 6


def test_a_single_environment_draws_every_episode_anew_and_its_seed_repeats_them():
    env = gymnasium.make(LITE, robot=ROBOTS[LITE], randomisation={"mass": (0.5, 2.0)}, joint_noise=0.0)
    robot = env.unwrapped.robot
    seen = []
    for seed in (3, None, None, 3, None):
        env.reset(seed=seed)
        seen.append(robot.model.body_mass.sum())
    assert len(set(seen[:3])) == 3
    assert seen[3:] == seen[:2]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"randomisation": {"mas": (1, 2)}}, "randomisation: unknown field 'mas'"),
        ({"command_delay": 0.01}, "command_delay: is 0.01 s beside a randomisation, expected it as a field of that"),
        ({"state_sampling": "on_command"}, "state_sampling: is 'on_command' beside a randomisation, expected now"),
        ({"actuation": "qfrc_applied"}, "actuation: is 'qfrc_applied', expected affine or implicit"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        gymnasium.make(LITE, **{"robot": ROBOTS[LITE], "randomisation": {"mass": (0.9, 1.1)}, **options})
