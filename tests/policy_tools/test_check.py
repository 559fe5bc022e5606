"""`policy check`: the model's answers, widths, stability, exit status. The contract is in test_checks.py."""

import json

import numpy as np
import onnx
import pytest
from findings import errors, found
from models import linear_model
from published import G1, POLICIES, TRACES, contract_beside, needs_policies
from trainer import contract, network, save_checkpoint, terms

from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.policy.readers.own import STAMP_KEY, encode, write_metadata
from humanoid_sim.policy_tools.check import check_checkpoint
from humanoid_sim.policy_tools.stamp import add_metadata


def test_a_sound_checkpoint_has_no_errors(walker, robot):
    findings = check_checkpoint(walker, robot)
    assert errors(findings) == []
    assert "none" in found(findings, "info", "golden vectors").message


def test_exit_status_and_json(cli, walker, robot, tmp_path):
    mjcf = robot.mjcf_path
    status, out, error = cli("check", walker, "--robot", mjcf)
    assert (status, error) == (0, "")
    assert out.splitlines()[-1].startswith(f"{walker} on 'walker': 0 error(s)")
    bad = save_checkpoint(tmp_path / "bad.onnx", contract(default_joint_pos=[-0.2, 0.1, 0.6, 2.5]))
    status, out, _ = cli("check", bad, "--robot", mjcf, "--json")
    assert status == 1
    document = json.loads(out)
    assert document["counts"]["error"] == 1
    finding = next(f for f in document["findings"] if f["severity"] == "error")
    assert (finding["field"], finding["joints"]) == ("default_joint_pos", ["right_knee"])
    for arguments in (
        ("check", tmp_path / "missing.onnx", "--robot", mjcf),
        ("check", walker, "--robot", "nobody"),
        ("check", walker, "--robot", mjcf, "--contract", tmp_path / "missing.yaml"),
    ):
        status, out, error = cli(*arguments)
        assert (status, out) == (2, "")
        assert error.count("\n") == 1
    assert cli("check", walker)[0] == 2  # which robot?


def test_widths_that_do_not_add_up(walker, robot):
    narrow = contract(observation=terms()[:-1])
    walker.write_bytes(add_metadata(walker, {**write_metadata(narrow), STAMP_KEY: encode(narrow)}))
    finding = found(check_checkpoint(walker, robot), "error", "observation")
    assert "is 30 wide" in finding.message
    assert "joint_pos_rel 12" in finding.message


def test_a_contract_that_cannot_be_is_a_finding(cli, walker, robot, tmp_path):
    walker.write_bytes(add_metadata(walker, {}))
    file = tmp_path / "negative.yaml"
    file.write_text("joint_damping: [1, -2, 1, 1]\n", encoding="utf-8")
    findings = check_checkpoint(walker, robot, file)
    assert len(findings) == 1
    assert "joint_damping" in found(findings, "error", "contract", "right_hip").message
    assert cli("check", walker, "--robot", robot.mjcf_path, "--contract", file)[0] == 1


def test_unstable_damping_names_joint_and_step(tmp_path, lite):
    """It is a warning where a step of the simulation would do, for `play` can be given that."""
    model = tmp_path / "lite.onnx"
    wiring = placeholder_checkpoint(lite).contract
    onnx.save(linear_model(write_metadata(wiring), inputs=42, outputs=14), str(model))
    assert errors(check_checkpoint(model, lite)) == []
    unstable = found(check_checkpoint(model, lite, physics_timestep=0.004), "error", "joint_damping", "physics step")
    assert "wrist" in unstable.joints[0]
    longest = float(unstable.message.partition("a step below ")[2].split()[0])
    assert errors(check_checkpoint(model, lite, physics_timestep=0.95 * longest)) == []


@pytest.mark.parametrize(("factor", "severity"), [(25.0, "warning"), (1000.0, "error")])
def test_damping_that_a_shorter_step_makes_stable_is_a_warning(tmp_path, robot, factor, severity):
    path = save_checkpoint(tmp_path / "walker.onnx", contract(joint_damping=np.array([1.5, 1.5, 2.0, 2.0]) * factor))
    finding = found(check_checkpoint(path, robot), severity, "joint_damping", "physics step")
    assert ("--physics-timestep" in finding.message) is (severity == "warning")


def test_the_models_answers(tmp_path, robot):
    path = save_checkpoint(tmp_path / "walker.onnx")
    model = onnx.load(str(path))

    def with_weights(weights):
        model.graph.initializer[0].raw_data = weights.astype(np.float32).tobytes()
        onnx.save(model, str(path))
        return check_checkpoint(path, robot)

    deaf = network().copy()
    deaf[3:6] = 0.0
    found(with_weights(deaf), "warning", "observation term projected_gravity", "no influence")
    found(with_weights(0.0 * deaf), "warning", "model", "whatever it observes")
    broken = network().copy()
    broken[0, 1] = np.inf  # 0 · infinity is not a number
    assert found(with_weights(broken), "error", "model", "not finite").joints == ("left_hip",)


@needs_policies
@pytest.mark.usefixtures("near_ends")
def test_published_policies(cli, tmp_path):
    for name, (model, _) in TRACES.items():
        rest = contract_beside(name, tmp_path)
        status, out, error = cli("check", POLICIES / model, "--robot", G1, *(("--contract", rest) if rest else ()))
        assert (status, error) == (0, ""), out
        assert "0 error(s)" in out
    status, out, _ = cli("check", POLICIES / TRACES["waltz"][0], "--robot", G1, "--hardware")
    assert status == 1
    for term in ("base_lin_vel", "motion_anchor_pos_b"):
        assert f"error   observation term {term}: needs" in out
    assert "assumed (mjlab): policy_dt 0.02 s (50 Hz)" in out
