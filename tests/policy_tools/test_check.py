"""`policy check`: the model's answers, widths, stability, exit status. The contract is in test_checks.py."""

import numpy as np
import onnx
import pytest
from policy_fixtures import found
from trainer import contract, network, save_checkpoint

from humanoid_sim.policy_tools.check import check_checkpoint


def test_exit_status(cli, walker, robot, tmp_path):
    mjcf = robot.mjcf_path
    status, out, error = cli("check", walker, "--robot", mjcf)
    assert (status, error) == (0, "")
    assert out.splitlines()[-1].startswith(f"{walker} on 'walker': 0 error(s)")
    bad = save_checkpoint(tmp_path / "bad.onnx", contract(default_joint_pos=[-0.2, 0.1, 0.6, 2.5]))
    status, out, _ = cli("check", bad, "--robot", mjcf)
    (line,) = [line for line in out.splitlines() if line.startswith("error")]
    assert (status, "default_joint_pos" in line, "right_knee" in line) == (1, True, True)
    for arguments in (
        ("check", tmp_path / "missing.onnx", "--robot", mjcf),
        ("check", walker, "--robot", "nobody"),
        ("check", walker, "--robot", mjcf, "--contract", tmp_path / "missing.yaml"),
    ):
        status, out, error = cli(*arguments)
        assert (status, out, error.count("\n")) == (2, "", 1)
    assert cli("check", walker)[0] == 2  # which robot?


@pytest.mark.parametrize(("factor", "named"), [(12.0, "stable, but"), (25.0, "use a step of less than")])
def test_damping_that_is_unstable_at_the_physics_step(tmp_path, robot, factor, named):
    path = save_checkpoint(tmp_path / "walker.onnx", contract(joint_damping=np.array([1.5, 1.5, 2.0, 2.0]) * factor))
    assert named in found(check_checkpoint(path, robot), "warning joint_damping: physics step").message


def test_an_answer_that_is_not_finite(tmp_path, robot):
    path = save_checkpoint(tmp_path / "walker.onnx")
    model, broken = onnx.load(str(path)), network().copy()
    broken[0, 1] = np.inf  # 0 · infinity is not a number
    model.graph.initializer[0].raw_data = broken.tobytes()
    onnx.save(model, str(path))
    assert "left_hip" in found(check_checkpoint(path, robot), "error model: expected a finite number").message


@pytest.mark.parametrize(
    ("operator", "line"), [("RandomNormalLike", "error model: it samples"), ("ConstantOfShape", "warning model: alike")]
)
def test_a_network_that_samples_or_observes_nothing(tmp_path, robot, operator, line):
    path = save_checkpoint(tmp_path / "walker.onnx")
    model = onnx.load(str(path))
    (last,) = model.graph.node
    action = last.output[0]
    last.output[0] = "mean"
    shape = [] if operator == "RandomNormalLike" else [onnx.helper.make_node("Shape", ["mean"], ["shape"])]
    made = onnx.helper.make_node(operator, ["shape" if shape else "mean"], [action])
    model.graph.node.extend([*shape, made])
    onnx.save(model, str(path))
    found(check_checkpoint(path, robot), line)


def test_a_normaliser_that_the_export_lost(walker, robot):
    agent = walker.with_name("agent.yaml")
    for text in ("policy: {actor_obs_normalization: true}", "empirical_normalization: true"):
        agent.write_text(text)
        found(check_checkpoint(walker, robot), "error model: with the normaliser")
    for text in ("empirical_normalization: false", "{policy: gpt, params: x}"):  # and another program's
        agent.write_text(text)
        assert not any(finding.field == "model" for finding in check_checkpoint(walker, robot))
