"""The native vector environment against Gymnasium's own, which steps `PolicyEnv`s one by one."""

from collections.abc import Mapping

import gymnasium
import numpy as np
import pytest
from alike import following
from gymnasium.vector import AutoresetMode
from models import contract_of

from humanoid_sim.controllers.contract import PhaseRule, Term
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch import Randomisation

LITE = "humanoid_sim/LiteTracking-v0"
BIPED = "humanoid_sim/BipedVelocity-v0"
POLICY = "humanoid_sim/Policy-v0"
COUNT = 3

# Read once: YAML takes longer than a thousand steps.
ROBOTS = {"lite": load_robot("lite"), "lite_biped": load_robot("lite_biped")}
ROBOT_OF = {LITE: ROBOTS["lite"], BIPED: ROBOTS["lite_biped"]}


def make(name, mode="vector_entry_point", count=COUNT, **options):
    if mode == "vector_entry_point":
        options = {"threads": 1, **options}
    if name in ROBOT_OF:
        options = {"robot": ROBOT_OF[name], **options}
    return gymnasium.make_vec(name, num_envs=count, vectorization_mode=mode, **options)


@pytest.fixture
def both(request):
    """Both kinds of the environment, and with the options, that the test asks for."""
    name, options = request.param
    mode = options.pop("autoreset_mode", AutoresetMode.NEXT_STEP)
    native = make(name, autoreset_mode=mode, **options)
    sync = make(name, "sync", vector_kwargs={"autoreset_mode": mode}, **options)
    yield native, sync
    native.close()
    sync.close()


def memory_policy():
    """A walking contract with a history, a gait clock and an anchor-free estimate of the base's velocity."""
    robot = ROBOTS["lite_biped"]
    return contract_of(
        robot.joint_names[::-1],
        action_joint_names=robot.joint_names[:12],
        joint_stiffness=robot.stiffness[::-1],
        joint_damping=robot.damping[::-1],
        observation=[
            Term("base_ang_vel", history=3),
            Term("projected_gravity", history=2),
            Term("base_lin_vel"),
            Term("velocity_commands"),
            Term("gait_phase"),
            Term("joint_pos", history=3),
            Term("joint_vel", scale=0.05),
            Term("last_action", history=2),
        ],
        action_scale=0.25,
        phase=PhaseRule(0.8, standing_threshold=0.1),
    )


def anchored():
    """A contract that follows the pelvis and the joints of a short motion, which starts somewhere else."""
    robot = ROBOTS["lite_biped"]
    frames = np.zeros((8, 2 * 14 + 7))
    frames[:, :14] = robot.initial_position
    frames[:, 28:31] = np.linspace([1.0, 2.0, 0.77], [1.1, 2.2, 0.77], 8)
    frames[:, [31, 34]] = np.sqrt(0.5)  # turned left by 90°
    motion = Motion(frames, ("pelvis",), 0.02, layout="joints_bodies_w", joint_names=robot.joint_names)
    return {"contract": following(robot), "robot": robot, "motion": motion, "max_episode_steps": 6}


def assert_same(ours, theirs, where=""):
    """Nested infos: the same keys, texts and masks, values equal to 1e-9."""
    if isinstance(theirs, Mapping):
        assert set(ours) == set(theirs), where
        for key in theirs:
            assert_same(ours[key], theirs[key], f"{where}/{key}")
    elif theirs.dtype == object:
        for i, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            if isinstance(other, np.ndarray):
                np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6, err_msg=f"{where}[{i}]")
            else:
                assert one == other, f"{where}[{i}]"
    else:
        assert ours.dtype == theirs.dtype, where
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9, err_msg=where)


def assert_states(native, sync):
    """Positions and velocities agree to 1e-9."""
    for i, env in enumerate(sync.envs):
        data = env.unwrapped.robot.data
        np.testing.assert_allclose(native.simulation.qpos[i], data.qpos, rtol=0, atol=1e-9)
        np.testing.assert_allclose(native.simulation.qvel[i], data.qvel, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "both",
    [
        (LITE, {"max_episode_steps": 5}),
        (LITE, {"max_episode_steps": 5, "autoreset_mode": AutoresetMode.SAME_STEP}),
        (BIPED, {"max_episode_steps": 9}),
        (POLICY, {"contract": memory_policy(), "robot": ROBOTS["lite_biped"], "max_episode_steps": 6}),
        (POLICY, anchored()),
    ],
    ids=["tracking", "tracking, same step", "velocity", "memory", "anchored"],
    indirect=True,
)
def test_every_step_is_that_of_single_environments(both):
    native, sync = both
    assert native.observation_space == sync.observation_space
    assert native.action_space == sync.action_space
    assert native.single_observation_space == sync.single_observation_space
    ours, theirs = native.reset(seed=5), sync.reset(seed=5)
    np.testing.assert_array_equal(ours[0], theirs[0])
    assert_same(ours[1], theirs[1])
    native.action_space.seed(0)
    ended = np.zeros(COUNT, dtype=np.int64)
    for step in range(14):
        action = 0.2 * native.action_space.sample()
        if step in (4, 11):  # the fifth step is also the last that two of the cases allow
            action[1, 4] = np.nan if step == 4 else 1e6
        ours, theirs = native.step(action), sync.step(action)
        assert ours[0].dtype == np.float32
        np.testing.assert_allclose(ours[0], theirs[0], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(ours[1], theirs[1], rtol=0, atol=1e-9)
        np.testing.assert_array_equal(ours[2], theirs[2])
        np.testing.assert_array_equal(ours[3], theirs[3])
        assert_same(ours[4], theirs[4])
        assert_states(native, sync)
        ended += ours[2] | ours[3]
    assert ended[1] >= 2
    assert ended.min() >= 1
    assert native.fault_count == sum(env.unwrapped.fault_count for env in sync.envs) >= 1


def test_seeds_make_starts():
    native = make(BIPED)
    first, _ = native.reset(seed=7)
    following, _ = native.reset()
    again, _ = native.reset(seed=[7, 8, 9])
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(native.reset()[0], following)
    assert np.abs(first - following).max() > 1e-3
    assert native.np_random_seed == 7
    mixed, _ = native.reset(seed=[7, None, 9])
    np.testing.assert_array_equal(mixed[[0, 2]], first[[0, 2]])
    assert np.abs(mixed[1] - first[1]).max() > 1e-3


def test_the_number_of_environments_and_threads_does_not_matter():
    options = {"randomisation": Randomisation(mass=(0.8, 1.2), command_delay=(0.0, 0.02), joint_position_noise=0.01)}
    few, many = make(LITE, count=1, **options), make(LITE, count=5, threads=2, **options)
    observed, _ = few.reset(seed=13)
    np.testing.assert_array_equal(observed[0], many.reset(seed=10)[0][3])
    many.action_space.seed(0)
    for _ in range(4):
        action = 0.1 * many.action_space.sample()
        ours, all_of_them = few.step(action[3:4]), many.step(action)
        np.testing.assert_array_equal(ours[0][0], all_of_them[0][3])
        np.testing.assert_array_equal(ours[1][0], all_of_them[1][3])


def test_a_mask_resets_some():
    native = make(LITE, autoreset_mode="Disabled", max_episode_steps=2)
    action = np.zeros(native.action_space.shape, dtype=np.float32)
    mask = np.array([True, False, True])
    with pytest.raises(gymnasium.error.ResetNeeded, match="the first reset is of all environments"):
        native.reset(options={"reset_mask": mask})
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset before step"):
        native.step(action)
    native.reset(seed=1)
    native.step(action)
    observation, info = native.reset(seed=[30, 31, 32], options={"reset_mask": mask})
    assert info["frame"].tolist() == [0, 0, 0]
    assert info["_frame"].tolist() == mask.tolist()
    fresh = make(LITE)
    np.testing.assert_array_equal(observation[mask], fresh.reset(seed=30)[0][mask])
    _, _, _, truncated, _ = native.step(action)
    assert truncated.tolist() == [False, True, False]
    with pytest.raises(gymnasium.error.ResetNeeded, match="an episode has ended"):
        native.step(action)
    native.reset(options={"reset_mask": ~mask})
    native.step(action)


def test_commands_of_the_caller_hold():
    native = make(BIPED)
    names = [term.name for term in native.scenario.contract.terms]
    layout = native.scenario.wiring.layout.terms[names.index("velocity_commands")]

    def commanded(observation):
        return np.asarray(observation[:, layout.start : layout.stop], dtype=np.float64)

    native.reset(seed=0, options={"command": (0.5, 0.1, -0.2)})
    observation, *_ = native.step(np.zeros(native.action_space.shape, dtype=np.float32))
    np.testing.assert_allclose(commanded(observation), [[0.5, 0.1, -0.2]] * COUNT, rtol=1e-6)
    rows = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.3, 0.0, 0.0]])
    observation, _ = native.reset(options={"command": rows})
    np.testing.assert_allclose(commanded(observation), rows, rtol=1e-6)


def test_a_simulation_that_breaks_ends_its_episode_only():
    native = make(LITE)
    native.reset(seed=0)
    last = native.step(np.zeros(native.action_space.shape, dtype=np.float32))[0]
    qvel = native.simulation.qvel.copy()
    qvel[2] = 1e12
    qpos = native.simulation.qpos.copy()
    native.simulation.reset([2], qpos=qpos[2:], qvel=qvel[2:])
    observation, reward, terminated, _, info = native.step(np.zeros(native.action_space.shape, dtype=np.float32))
    assert terminated.tolist() == [False, False, True]
    assert reward[2] == 0.0
    assert info["fault"].tolist() == [None, None, "simulation unstable"]
    np.testing.assert_array_equal(observation[2], last[2])
    native.step(np.zeros(native.action_space.shape, dtype=np.float32))
    assert np.isfinite(native.step(np.zeros(native.action_space.shape, dtype=np.float32))[0]).all()
    assert native.fault_count == 1


def test_randomised_environments_differ_and_are_seeded():
    native = make(LITE, count=4, randomisation={"mass": (0.5, 2.0), "joint_friction": [0.5, 2.0]}, joint_noise=0.0)
    native.reset(seed=3)
    masses = [native.simulation.model(i).body_mass.sum() for i in range(4)]
    assert len(set(masses)) == 4
    native.reset()
    following = [native.simulation.model(i).body_mass.sum() for i in range(4)]
    assert len({*masses, *following}) == 8
    native.reset(seed=4)
    assert [native.simulation.model(i).body_mass.sum() for i in range(3)] == masses[1:]
    native.reset()
    assert [native.simulation.model(i).body_mass.sum() for i in range(3)] == following[1:]


def test_a_wrench_pushes_as_long_as_it_is_set():
    env = PolicyVectorEnv(2, "lite_biped_velocity", "lite_biped", actuation="implicit")
    env.reset(seed=0, options={"command": (0.0, 0.0, 0.0)})
    env.wrench = np.zeros((2, 6))
    env.wrench[1, 1] = 50.0  # N, to the left
    still = np.zeros((2, 14), dtype=np.float32)
    for _ in range(5):
        env.step(still)
    left = env.simulation.qvel[:, 1].copy()
    assert abs(left[0]) < 0.1
    assert left[1] > 0.4
    env.wrench = None
    env.step(still)
    assert env.simulation.qvel[1, 1] < left[1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"render_mode": "human"}, "render_mode: is 'human', expected rgb_array or None for a vector environment"),
        ({"max_episode_steps": 0}, "max_episode_steps: is 0, expected a whole number >= 1"),
        ({"autoreset_mode": "Later"}, "autoreset_mode: is 'Later', expected NextStep, SameStep or Disabled"),
        ({"randomisation": {"colour": (0, 1)}}, "randomisation: unknown field 'colour'; known: mass, centre_of_mass"),
        ({"randomisation": "mass"}, "randomisation: is 'mass', expected its fields by name, or None"),
        ({"randomisation": {"command_delay": (0.0, 60.0)}}, "command_delay is .*, expected at most 1 s"),
        ({"threads": 0}, "threads: is 0"),
        ({"command_delay": 0.01}, "^unknown option 'command_delay'; known: num_envs, contract, .* threads, .* rewards"),
        ({"autoreset": "SameStep"}, r"^unknown option 'autoreset' \(did you mean 'autoreset_mode'\?\)"),
        ({"width": 0}, "width: is 0"),
        ({"count": 0}, "num_envs: is 0, expected a whole number >= 1"),
        ({"physics_timestep": 0.005}, "unstable above 2"),
        ({"motion": "polka"}, "polka"),
        ({"actuation": "qfrc_applied"}, "actuation: is 'qfrc_applied', expected affine or implicit"),
        ({"actuation": "implicit", "physics_timestep": 0.003}, "0.003"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        make(LITE, **options)


def test_bad_resets_and_actions_are_named():
    native = make(LITE)
    for arguments, message in (
        ({"seed": [1, 2]}, r"reset: seed is \[1, 2\], expected a whole number >= 0, or 3 of them"),
        ({"seed": -1}, "reset: seed is -1, expected a whole number >= 0"),
        ({"seed": [1, 2.5, 3]}, "reset: seed is"),
        ({"seed": "abc"}, "reset: seed is 'abc'"),
        ({"options": {"speed": 1}}, "reset: unknown option 'speed'; known: command, reset_mask"),
        ({"options": {"command": (1.0, 2.0)}}, "reset: command is"),
        ({"options": {"command": "fast"}}, "reset: command is 'fast'"),
        ({"options": {"reset_mask": np.zeros(3, dtype=bool)}}, "reset: reset_mask is"),
        ({"options": {"reset_mask": [True, True, True]}}, "reset: reset_mask is"),
    ):
        with pytest.raises(InputError, match=message):
            native.reset(**arguments)
    native.reset(seed=0)
    with pytest.raises(InputError, match=r"actions: have shape \(14,\), expected \(3, 14\)"):
        native.step(np.zeros(14, dtype=np.float32))
    observation, info = native.reset(seed=0)
    with pytest.raises(InputError, match=r"observation: has shape \(3, \d+\), expected \(\d+,\), of one robot"):
        native.unwrapped.scenario.policy(observation, info["frame"])


@pytest.mark.parametrize("name", [LITE, BIPED])
def test_the_implicit_plant_does_in_a_batch_what_it_does_alone(name):
    native = make(name, actuation="implicit")
    single = gymnasium.make(name, actuation="implicit")
    exact = make(name)
    assert native.simulation.physics_steps == 8
    assert exact.simulation.physics_steps == 40
    seen = [native.reset(seed=5)[0][0], single.reset(seed=5)[0], exact.reset(seed=5)[0][0]]
    np.testing.assert_array_equal(seen[0], seen[1])
    rng = np.random.default_rng(6)
    apart = 0.0
    for _ in range(12):
        action = rng.uniform(-0.3, 0.3, native.single_action_space.shape).astype(np.float32)
        actions = np.tile(action, (3, 1))
        together, alone, other = native.step(actions)[0][0], single.step(action)[0], exact.step(actions)[0][0]
        np.testing.assert_allclose(together, alone, rtol=0.0, atol=1e-9)
        apart = max(apart, float(np.abs(together - other).max()))
    assert 1e-6 < apart < 0.5
