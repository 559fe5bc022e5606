from itertools import pairwise

import numpy as np
import onnxruntime

from humanoid_sim.assets import asset_path
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.readers.contract_yaml import read_contract_file
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.robots.description import load_robot
from tools.samples.walking.aim import Aim
from tools.samples.walking.export import export_walking
from tools.samples.walking.gait import (
    ANSWERS,
    INPUTS,
    MOST,
    OBSERVATIONS,
    awake,
    from_canonical,
    gait,
    network_input,
    to_canonical,
)

CONTRACT = asset_path("policies", "lite_biped_velocity.contract.yaml")


def test_the_graph_is_the_network_between_two_mirrors(tmp_path):
    rng = np.random.default_rng(0)
    sizes = (INPUTS, 8, ANSWERS)
    weights = {}
    for i, (given, made) in enumerate(pairwise(sizes)):
        weights[f"network.{i}.weight"] = rng.normal(size=(made, given)).astype(np.float32)
        weights[f"network.{i}.bias"] = rng.normal(size=made).astype(np.float32)
    path = tmp_path / "walk.onnx"
    contract = merge(read_contract_file(CONTRACT), str(CONTRACT), load_robot("lite_biped").joint_names)
    aim = Aim(
        np.array([0.2, 0.5, 0.6, 0.9, 1.0]),
        1.2,
        np.array([[1.1, -0.2], [0.4, 1.3]]),
        np.array([[-0.5, 0.8], [-0.4, 0.4], [-0.8, 0.8]]),
    )
    export_walking(path, weights, contract, aim)

    observations = rng.normal(size=(32, OBSERVATIONS)).astype(np.float32)
    observations[:16, 6:9] = 0.0
    observations[:16, [0, 1, *range(23, 37)]] *= np.linspace(0.0, 0.02, 16)[:, None]  # some at rest, some stirred
    told = observations.copy()
    told[:, 6:9] = aim.told(observations[:, 6:9].astype(np.float64))
    assert bool((told[:, 6] == np.float32(0.8)).any())
    seen, mirrored = to_canonical(awake(told))
    shares = np.abs(seen[:16, 52] / told[:16, 52])  # which the mirror turns round
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert ((shares > 0.0) & (shares < 1.0)).any()
    hidden = network_input(seen) @ weights["network.0.weight"].T + weights["network.0.bias"]
    hidden = np.where(hidden > 0.0, hidden, np.expm1(np.minimum(hidden, 0.0)))
    added = np.clip(hidden @ weights["network.1.weight"].T + weights["network.1.bias"], -MOST, MOST)
    assert bool((np.abs(added) == MOST).any())
    expected = from_canonical(gait(seen, added), mirrored)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    (actual,) = session.run(None, {"obs": observations})
    np.testing.assert_allclose(actual, expected, atol=1e-4)
    checkpoint = load_checkpoint(path, CONTRACT)
    assert checkpoint.contract.task_type == "locomotion"
    np.testing.assert_allclose(checkpoint.policy(observations[0], 0), expected[0], atol=1e-4)
