import shutil
import subprocess
import sys

import numpy as np
import pytest

from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.robots.description import load_robot

# Actions are those of the policy, in its own units: nothing to be normalised.
pytestmark = pytest.mark.filterwarnings("ignore:.*recommend using a symmetric and normalized space")

ARMS = {"contract": "lite_tracking", "robot": "lite", "motion": "wave"}
LEGS = {"contract": "lite_biped_velocity", "robot": "lite_biped"}


@pytest.fixture(scope="module")
def arms():
    env = PolicyEnv(**ARMS)
    yield env
    env.close()


@pytest.fixture(scope="module")
def legs():
    env = PolicyEnv(**LEGS, episode_seconds=1.0)
    yield env
    env.close()


def test_the_sample_policy_follows_its_motion_to_the_end(arms):
    observation, info = arms.reset(seed=1)
    total, steps, over = 0.0, 0, False
    while not over:
        assert arms.observation_space.contains(observation)
        action = arms.scenario.policy(observation, info["frame"])
        assert arms.action_space.contains(action)
        observation, reward, terminated, over, info = arms.step(action)
        steps += 1
        assert not terminated
        assert reward == pytest.approx(sum(info["terms"].values()), abs=1e-15)
        assert info["frame"] == min(steps, 400)
        total += reward
    assert steps == 400  # 401 frames, 20 ms apart
    assert 1.47 < total / 8.0 < 1.5  # 1.5 per second is perfect


def test_a_seed_decides_the_episode(arms):
    def rollout(seed):
        observation, info = arms.reset(seed=seed)
        seen = [observation.tobytes()]
        for _ in range(5):
            observation, reward, *_, info = arms.step(arms.scenario.policy(observation, info["frame"]))
            seen += [observation.tobytes(), np.float64(reward).tobytes()]
        return seen

    first, second = rollout(3), rollout(None)
    assert first != second  # the generator goes on
    assert rollout(3) == first
    assert rollout(None) == second
    assert rollout(4) != first


def test_standing_legs_stand_until_the_time_is_up(legs):
    legs.reset(seed=0, options={"command": (0.0, 0.0, 0.0)})
    for step in range(1, 51):
        _, reward, terminated, truncated, info = legs.step(np.zeros(14, dtype=np.float32))
        assert (terminated, truncated) == (False, step == 50)
    assert info["frame"] == 0
    assert reward == pytest.approx(2.0 * 0.02, rel=0.05)  # stands still, as it is told


def test_folding_legs_fall(legs):
    legs.reset(seed=0)
    action = np.zeros(14, dtype=np.float32)
    action[[0, 7]] = 5.0  # both hips stretch: it falls on its face
    for _ in range(49):
        _, _, terminated, _, info = legs.step(action)
        if terminated:
            break
    assert terminated
    assert "fault" not in info  # a failure at the task, not of the policy
    base = legs.robot.base_state
    assert base.tilt > 1.0 or base.height < 0.5


@pytest.mark.parametrize(("value", "shown"), [(np.nan, "nan"), (-np.inf, "-inf"), (101.0, "101.0"), (1e300, "inf")])
def test_a_bad_action_is_a_counted_fault_and_ends_the_episode(arms, value, shown):
    observation, _ = arms.reset(seed=0)
    observation, *_ = arms.step(np.zeros(14))
    before, count = arms.robot.qpos, arms.fault_count
    hint = ": --action-limit, or action_limit in a contract.yaml, raises it" if value == 101.0 else ""
    action = np.zeros(14)
    action[3] = value
    after, reward, terminated, truncated, info = arms.step(action)
    assert (reward, terminated, truncated, arms.fault_count) == (0.0, True, False, count + 1)
    assert info["fault"] == f"action of left_elbow_pitch is {shown}, expected a magnitude <= 100{hint}"
    np.testing.assert_array_equal(after, observation)
    np.testing.assert_array_equal(arms.robot.qpos, before)  # nothing was commanded
    arms.reset(seed=0)
    assert not arms.step(np.zeros(14))[2]


def test_a_simulation_that_is_no_longer_sound_is_a_fault(arms):
    arms.reset(seed=0)
    arms.robot.data.qvel[5] = np.nan
    observation, reward, terminated, _, info = arms.step(np.zeros(14))
    assert terminated
    assert reward == 0.0
    assert info["fault"].startswith("simulation unstable: ")
    assert arms.observation_space.contains(observation)
    assert "fault" not in arms.reset(seed=0)[1]
    assert "fault" not in arms.step(np.zeros(14))[4]


def test_delays_are_between_robot_and_policy_and_not_in_the_reward():
    prompt, late = PolicyEnv(**ARMS), PolicyEnv(**ARMS, state_delay=0.01)
    starts = [env.reset(seed=5)[0] for env in (prompt, late)]
    np.testing.assert_array_equal(*starts)
    action = np.full(14, 0.5, dtype=np.float32)
    (seen, reward, *_), (seen_late, reward_late, *_) = prompt.step(action), late.step(action)
    assert np.abs(seen[36:50] - seen_late[36:50]).max() > 1e-3  # joint positions, half a step apart
    assert reward == pytest.approx(reward_late, abs=1e-12)
    behind = PolicyEnv(**ARMS, command_delay=0.005)
    behind.reset(seed=5)
    assert behind.step(action)[1] != pytest.approx(reward, abs=1e-9)


def test_both_plants_give_the_same_episode():
    envs = [PolicyEnv(**ARMS, actuation=actuation) for actuation in ("affine", "qfrc_applied")]
    for env in envs:
        env.reset(seed=7)
    rng = np.random.default_rng(0)
    for _ in range(20):
        action = rng.normal(0.0, 0.5, 14)
        (a, reward_a, *_), (b, reward_b, *_) = (env.step(action) for env in envs)
        np.testing.assert_allclose(a, b, atol=1e-6)  # float32
        assert reward_a == pytest.approx(reward_b, abs=1e-9)


def test_any_contract_on_any_robot():
    for robot in ("lite_neck", "lite_biped"):
        env = PolicyEnv(placeholder_checkpoint(load_robot(robot)).contract, robot, task="balance", episode_seconds=0.1)
        env.reset(seed=0)
        steps = [env.step(np.zeros(env.action_space.shape)) for _ in range(5)]
        assert [step[3] for step in steps] == [False] * 4 + [True]
        assert all("fault" not in step[4] for step in steps)
        assert steps[0][1] == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize("robot", ["arms", "legs"])
@pytest.mark.parametrize("scale", [1.0, 30.0])
def test_whatever_is_done_the_values_are_those_of_the_spaces(robot, scale, request):
    env = request.getfixturevalue(robot)
    rng, over, ends = np.random.default_rng(0), True, 0
    for _ in range(150):
        if over:
            observation, _ = env.reset(seed=int(rng.integers(1000)))
            assert env.observation_space.contains(observation)
        observation, reward, terminated, truncated, info = env.step(rng.normal(0.0, scale, 14))
        over = terminated or truncated
        ends += over
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
        assert "fault" not in info or terminated
        assert reward <= 2.0 * 0.02
    assert ends > 0 or scale == 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({**ARMS, "robot": "lite_biped"}, "joint_names of the policy do not match the robot's joints"),
        ({**ARMS, "motion": None}, r"motion: is missing; .*lite_tracking\.onnx is a tracking policy and follows one"),
        ({**ARMS, "motion": "tango"}, "^motion: unknown motion 'tango'; known: circle, drum"),
        ({**LEGS, "motion": "wave"}, r"motion: is 'wave', but .*lite_biped_velocity\.onnx follows no motion"),
        ({**ARMS, "contract": "lite_dance"}, r"^policy: unknown policy 'lite_dance'; known: .* lite_tracking; or a "),
        ({**ARMS, "contract": "dance.txt"}, r"^policy: is 'dance.txt', expected a checkpoint \(.onnx\) or a contract"),
        ({**LEGS, "robot": "atlas"}, "unknown robot 'atlas'"),
        ({**ARMS, "task": "velocity"}, "lite: has a fixed base, expected a floating one"),
        ({**ARMS, "action_limit": 0.0}, "action_limit: is 0.0, expected a number > 0"),
        ({**ARMS, "action_limit": np.inf}, r"action_limit: is inf, expected a number > 0 and at most 3\.40282e\+38"),
        (
            {**ARMS, "speed": 1.0},
            "^unknown option 'speed'; known: contract, robot, .* randomisation, .* reference_start, weights, ",
        ),
        ({**LEGS, "standing_height": 1.0}, "^unknown option 'standing_height'; known: contract"),
        ({**ARMS, "randomization": {}}, r"^unknown option 'randomization' \(did you mean 'randomisation'\?\)"),
        ({**ARMS, "actuaton": "implicit"}, r"^unknown option 'actuaton' \(did you mean 'actuation'\?\)"),
        ({**ARMS, "reference_strat": 0.5}, r"^unknown option 'reference_strat' \(did you mean 'reference_start'\?\)"),
        ({**ARMS, "weigths": {}}, r"^unknown option 'weigths' \(did you mean 'weights'\?\)"),
        ({**ARMS, "episode_seconds": "long"}, "^episode_seconds: is long, expected a finite number >= 0"),
        ({**ARMS, "width": 0}, "width: is 0, expected a whole number of pixels >= 1"),
        ({**ARMS, "height": 2.5}, r"height: is 2\.5, expected a whole number of pixels >= 1"),
        ({**ARMS, "physics_timestep": 0.003}, "physics_timestep: 0.003 s does not divide the control period"),
        ({**ARMS, "actuation": "magic"}, "actuation: is 'magic', expected qfrc_applied, affine or implicit"),
        ({**ARMS, "weights": {"speed": 1.0}}, "weights: unknown reward term 'speed'"),
        ({**ARMS, "render_mode": "ansi"}, "render_mode: is 'ansi', expected human, rgb_array or None"),
    ],
)
def test_what_does_not_fit_is_one_line(options, message):
    with pytest.raises(InputError, match=message) as refused:
        PolicyEnv(**options)
    assert "\n" not in str(refused.value)


def test_pictures_need_opengl(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    env = PolicyEnv(**ARMS, render_mode="rgb_array", width=160, height=120)
    env.reset()
    with pytest.raises(InputError, match=r"^pictures: no OpenGL \(MUJOCO_GL=off\) here; Debian's package libosmesa6"):
        env.render()
    env.close()
    env.close()
    assert env.metadata["render_fps"] == 50


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="xvfb-run is not installed (xvfb)")
@pytest.mark.parametrize("name", ["LiteTracking-v0", "LiteModes-v0"])
def test_windows_open_one_at_a_time_and_gymnasium_s_checker_sees_every_render_mode(name):
    script = f"""
import gymnasium, humanoid_sim
from gymnasium.utils.env_checker import check_env
from humanoid_sim.errors import InputError
check_env(gymnasium.make("humanoid_sim/{name}").unwrapped)
first, second = (gymnasium.make("humanoid_sim/{name}", render_mode="human") for _ in range(2))
first.reset()
for _ in range(5):
    first.step(first.action_space.sample())
try:
    second.reset()
except InputError as error:
    print(error)
first.close()
second.reset()
second.close()
print("closed")
"""
    command = ["xvfb-run", "-a", sys.executable, "-W", "ignore", "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    expected = "render_mode: human is shown by another environment of this process; close that one first\nclosed\n"
    assert done.stdout == expected, done.stderr
