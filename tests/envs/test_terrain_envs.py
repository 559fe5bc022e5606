"""Walking on ground that is not flat, and policies that observe it: single, many, in the whole stack."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from alike import FIELD, both, walk_along
from models import linear_model, saved

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.assets import policy_path
from humanoid_sim.controllers.terms import Term
from humanoid_sim.envs import dm
from humanoid_sim.envs.modes_env import ModesEnv
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.robots.description import load_robot

pytestmark = pytest.mark.filterwarnings("ignore:.*recommend using a symmetric and normalized space")

BIPED, LITE = "humanoid_sim/BipedVelocity-v0", "humanoid_sim/LiteTracking-v0"
ROBOT = load_robot("lite_biped")


@pytest.mark.parametrize(
    "options", [{}, {"randomisation": {"mass": (0.9, 1.1), "push": (0.1, 0.3), "state_delay": (0.0, 0.01)}}]
)
def test_every_step_is_that_of_single_environments(options):
    native, sync = both(BIPED, 3, robot=ROBOT, terrain=FIELD, actuation="implicit", **options)
    walk_along(native, sync, 12, 0.5)
    native.reset(seed=3)
    assert len({tuple(start) for start in native.simulation.base.position[:, :2].tolist()}) > 1


@pytest.mark.parametrize("kind", ["rough", "slopes", "steps"])
def test_it_begins_with_its_feet_on_the_ground_wherever_that_is(kind):
    flat = gymnasium.make_vec(BIPED, num_envs=8, threads=1, robot=ROBOT, joint_noise=0.0)
    hilly = gymnasium.make_vec(BIPED, num_envs=8, threads=1, robot=ROBOT, joint_noise=0.0, terrain=kind)
    for envs in (flat, hilly):
        envs.reset(seed=0)
    level, base = flat.simulation.base, hilly.simulation.base
    np.testing.assert_allclose(base.height, level.height, rtol=0, atol=1e-6)  # heights are stored as float32
    np.testing.assert_allclose(base.mass_height, level.mass_height, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(base.quaternion, level.quaternion)
    assert len(set(base.position[:, 0])) > 1
    if kind != "rough":
        assert np.ptp(base.floor) > 0.1
    for _ in range(5):
        terminated = hilly.step(np.zeros(hilly.action_space.shape, dtype=np.float32))[2]
        flat.step(np.zeros(flat.action_space.shape, dtype=np.float32))
    assert not terminated.any()
    np.testing.assert_allclose(hilly.simulation.base.height, flat.simulation.base.height, rtol=0, atol=2e-3)


def harder(progress):
    return {"terrain": progress}


def test_a_curriculum_lets_it_onto_harder_tiles():
    envs = gymnasium.make_vec(
        BIPED, num_envs=30, threads=1, robot=ROBOT, terrain={"kind": "slopes", "levels": 3}, curriculum=harder
    )
    columns = []
    for progress in (0.0, 0.5, 1.0):
        envs.progress = progress
        envs.reset(seed=0)
        columns.append(len(set(envs.simulation.qpos[:, 0])))
    assert columns == [1, 2, 3]


@pytest.mark.slow
def test_pictures_show_the_ground_and_the_robot_on_it():
    pictures = []
    for terrain in ("flat", {"kind": "slopes", "slope": 0.5, "levels": 1}):
        env = gymnasium.make(BIPED, robot=ROBOT, terrain=terrain, render_mode="rgb_array", width=96, height=72)
        env.reset(seed=0)
        pictures.append(np.asarray(env.render(), dtype=np.int64))
        env.close()
    middle = (slice(20, 50), slice(40, 56))  # where it stands
    dark = [int((picture[middle].sum(axis=-1) < 250).sum()) for picture in pictures]
    assert min(dark) > 30
    assert np.abs(pictures[0] - pictures[1]).max() > 20


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        (LITE, {"terrain": "rough"}, "terrain: is rough, and 'lite' has a fixed base, expected flat"),
        (BIPED, {"terrain": "stairs"}, "terrain: unknown kind 'stairs'"),
    ],
)
def test_ground_that_does_not_fit_is_refused(name, options, message):
    with pytest.raises(InputError, match=message):
        gymnasium.make(name, **options)


POLICY = "humanoid_sim/Policy-v0"
GROUND = {"kind": "mixed", "levels": 2, "variants": 3, "tile": 3.0, "platform": 0.4}
COUNT, RAYS = 3, 6 * 4


@pytest.fixture(scope="module")
def contract():
    """The shipped policy that walks, which sees the ground ahead as well."""
    walking = load_checkpoint(policy_path("lite_biped_velocity")).contract
    scan = Term("height_scan", at="imu", grid=(1.0, 0.6), resolution=0.2, scale=0.5)
    return replace(walking, observation=(*walking.terms, scan))


def test_every_step_of_policies_that_see_the_ground_is_that_of_single_environments(contract):
    native, sync = both(POLICY, COUNT, contract=contract, robot=ROBOT, terrain=GROUND, actuation="implicit", threads=2)
    walk_along(native, sync, 8, 0.3)
    scans = native._observation[:, -RAYS:]
    assert np.ptp(scans, axis=1).max() > 0.005, "the ground is not level"
    base = native.simulation.base.position[:, 2]
    assert np.abs(2.0 * scans.mean(axis=1) - base).max() < 0.5


def test_dm_control_sees_what_gymnasium_sees(contract):
    pytest.importorskip("dm_control.rl.control")
    given = {"contract": contract, "robot": ROBOT, "terrain": GROUND}
    theirs = gymnasium.make(POLICY, **given).unwrapped
    ours = dm.load("policy", seed=3, **given)
    observation, _ = theirs.reset(seed=3)
    step = ours.reset()
    assert step.observation["height_scan"].tolist() == observation[-RAYS:].tolist()
    action = 0.1 * np.ones(theirs.action_space.shape, dtype=np.float32)
    assert ours.step(action).observation["height_scan"].tolist() == theirs.step(action)[0][-RAYS:].tolist()


def test_the_state_machines_environment_takes_the_scan_with_the_policy(contract, tmp_path):
    path = tmp_path / "walker.onnx"
    width = contract_layout(contract).width
    weights = {"inputs": width, "outputs": contract.action_count}
    saved(path, linear_model({**write_metadata(contract), STAMP_KEY: encode(contract)}, **weights))
    modes = ModesEnv(ROBOT, policy=path)
    assert modes.robot.extern["height_scan"] == RAYS
    modes.reset(seed=0)
    assert np.ptp(modes.robot.read()[0].extern["height_scan"].value) < 0.01, "it stands on a level floor"
