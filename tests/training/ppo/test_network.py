import dataclasses

import numpy as np
import onnxruntime
import pytest

from humanoid_sim.controllers.contract import TensorNames
from humanoid_sim.errors import HumanoidSimError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.training.ppo.environment import subject_of
from humanoid_sim.training.ppo.export import require_same_answers, write_network
from humanoid_sim.training.ppo.learner import Actor
from humanoid_sim.training.ppo.options import TrainConfig

torch = pytest.importorskip("torch")

LEGS = subject_of(TrainConfig(robot="lite_biped")).contract


def actor():
    """53 values through layers with weights of order one; ELU between them."""
    rng = np.random.default_rng(0)
    layers = [torch.nn.Linear(53, 8), torch.nn.ELU(), torch.nn.Linear(8, 6), torch.nn.ELU(), torch.nn.Linear(6, 14)]
    for layer in layers[::2]:
        for values in layer.parameters():
            values.data = torch.from_numpy(rng.normal(size=values.shape).astype(np.float32))
    return Actor(torch.nn.Sequential(*layers), (53, 14), lambda observations: answers(layers[::2], observations))


def answers(layers, observations):
    """What the arrays come to, by hand."""
    value = observations
    for layer in layers:
        value = value @ layer.weight.detach().numpy().T + layer.bias.detach().numpy()
        if layer is not layers[-1]:
            value = np.where(value > 0.0, value, np.expm1(np.minimum(value, 0.0)))
    return value


def test_the_file_answers_what_the_arrays_do(tmp_path):
    path, trained = tmp_path / "policy.onnx", actor()
    write_network(path, trained, LEGS, "policy")
    observations = np.random.default_rng(1).normal(size=(20, 53)).astype(np.float32)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    (actual,) = session.run(["actions"], {"obs": observations})
    np.testing.assert_allclose(actual, trained.answer(observations), rtol=1e-4, atol=1e-4)
    assert np.abs(actual).max() > 1.0


def test_the_file_holds_its_whole_contract(tmp_path):
    path = tmp_path / "policy.onnx"
    elsewhere = dataclasses.replace(LEGS, tensors=TensorNames("observations", "mu"))  # of another model's
    write_network(path, actor(), elsewhere, "policy")
    contract = load_checkpoint(path).contract
    assert contract.phase is not None  # which the thirteen keys alone cannot say
    assert contract.command_ranges is not None
    assert contract.joint_names == LEGS.joint_names
    np.testing.assert_array_equal(contract.command_ranges, LEGS.command_ranges)


def test_an_export_that_answers_otherwise_is_a_defect(tmp_path):
    path, trained = tmp_path / "policy.onnx", actor()
    write_network(path, trained, LEGS, "policy")
    observations = np.random.default_rng(1).normal(size=(4, 53)).astype(np.float32)
    require_same_answers(load_checkpoint(path), observations, trained.answer(observations))
    other = trained.answer(observations)
    other[2, 3] += 0.02 * max(1.0, abs(other[2, 3]))
    with pytest.raises(
        HumanoidSimError, match=r"policy\.onnx: its actions differ from the network's by up to 0\.0[12]"
    ):
        require_same_answers(load_checkpoint(path), observations, other)
