"""Environments whose policy observes the ground: single, many, for dm_control, and those of the whole state machine."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from alike import both, walk_along
from models import linear_model, saved

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.assets import policy_path
from humanoid_sim.controllers.terms import Term
from humanoid_sim.envs import dm
from humanoid_sim.envs.modes_env import ModesEnv
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.robots.description import load_robot

POLICY = "humanoid_sim/Policy-v0"
ROBOT = load_robot("lite_biped")
FIELD = {"kind": "mixed", "levels": 2, "variants": 3, "tile": 3.0, "platform": 0.4}
COUNT, RAYS = 3, 6 * 4


@pytest.fixture(scope="module")
def contract():
    """The shipped policy that walks, which sees the ground ahead as well."""
    walking = load_checkpoint(policy_path("lite_biped_velocity")).contract
    scan = Term("height_scan", at="imu", grid=(1.0, 0.6), resolution=0.2, scale=0.5)
    return replace(walking, observation=(*walking.terms, scan))


def test_every_step_is_that_of_single_environments(contract):
    native, sync = both(POLICY, COUNT, contract=contract, robot=ROBOT, terrain=FIELD, actuation="implicit", threads=2)
    walk_along(native, sync, 8, 0.3)
    scans = native._observation[:, -RAYS:]
    assert np.ptp(scans, axis=1).max() > 0.005, "the ground is not level"
    base = native.simulation.base.position[:, 2]
    assert np.abs(2.0 * scans.mean(axis=1) - base).max() < 0.5


def test_dm_control_sees_what_gymnasium_sees(contract):
    pytest.importorskip("dm_control.rl.control")
    given = {"contract": contract, "robot": ROBOT, "terrain": FIELD}
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
