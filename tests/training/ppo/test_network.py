import dataclasses
from itertools import pairwise

import numpy as np
import onnxruntime
import pytest

from humanoid_sim.controllers.contract import TensorNames
from humanoid_sim.errors import HumanoidSimError, InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.training.ppo.environment import subject_of
from humanoid_sim.training.ppo.network import Network, require_same_answers, write_network
from humanoid_sim.training.ppo.options import TrainConfig

LEGS = subject_of(TrainConfig(robot="lite_biped")).contract


def network(bounds):
    rng = np.random.default_rng(0)
    sizes = (53, 8, 6, 14)
    layers = tuple(
        (rng.normal(size=(made, given)).astype(np.float32), rng.normal(size=made).astype(np.float32))
        for given, made in pairwise(sizes)
    )
    mean, deviation = rng.normal(size=53), 0.2 + rng.random(53)
    limits = (np.full(14, -1.0, dtype=np.float32), np.full(14, 0.5, dtype=np.float32)) if bounds else None
    return Network(mean.astype(np.float32), deviation.astype(np.float32), layers, limits)


def answers(trained, observations):
    """What the arrays come to, by hand: ELU between the layers."""
    value = (observations - trained.mean) / trained.deviation
    for i, (weight, bias) in enumerate(trained.layers):
        value = value @ weight.T + bias
        if i < 2:
            value = np.where(value > 0.0, value, np.expm1(np.minimum(value, 0.0)))
    return value if trained.bounds is None else np.clip(value, -1.0, 0.5)


@pytest.mark.parametrize("bounds", [False, True])
def test_the_file_answers_what_the_arrays_do(bounds, tmp_path):
    path, trained = tmp_path / "policy.onnx", network(bounds)
    write_network(path, trained, LEGS, "policy")
    observations = np.random.default_rng(1).normal(size=(20, 53)).astype(np.float32)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    (actual,) = session.run(["actions"], {"obs": observations})
    np.testing.assert_allclose(actual, answers(trained, observations), rtol=1e-4, atol=1e-4)
    assert bool((np.abs(actual) > 1.0).any()) is not bounds


def test_the_file_holds_its_whole_contract(tmp_path):
    path = tmp_path / "policy.onnx"
    elsewhere = dataclasses.replace(LEGS, tensors=TensorNames("observations", "mu"))  # of another model's
    write_network(path, network(bounds=False), elsewhere, "policy")
    contract = load_checkpoint(path).contract
    assert contract.phase is not None  # which the thirteen keys alone cannot say
    assert contract.command_ranges is not None
    assert contract.joint_names == LEGS.joint_names
    np.testing.assert_array_equal(contract.command_ranges, LEGS.command_ranges)


def test_an_export_that_answers_otherwise_is_a_defect(tmp_path):
    path, trained = tmp_path / "policy.onnx", network(bounds=False)
    write_network(path, trained, LEGS, "policy")
    observations = np.random.default_rng(1).normal(size=(4, 53)).astype(np.float32)
    require_same_answers(load_checkpoint(path), observations, answers(trained, observations))
    other = answers(trained, observations)
    other[2, 3] += 0.02 * max(1.0, abs(other[2, 3]))
    with pytest.raises(
        HumanoidSimError, match=r"policy\.onnx: its actions differ from the network's by up to 0\.0[12]"
    ):
        require_same_answers(load_checkpoint(path), observations, other)


def test_a_folder_that_is_gone_is_one_line(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_network(tmp_path / "gone" / "policy.onnx", network(bounds=False), LEGS, "policy")
