"""`policy check`: every finding by its field, joint, value and limit."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest
from findings import errors, found, lite_contract
from models import linear_model
from published import G1, POLICIES, TRACES, contract_beside, needs_policies
from trainer import contract, network, save_checkpoint, terms

from humanoid_sim.controllers.terms import Term
from humanoid_sim.policy.checks import (
    naming_findings,
    range_findings,
    sorted_findings,
    suspicious_findings,
)
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.policy_tools.check import check_checkpoint
from humanoid_sim.policy_tools.stamp import add_metadata


def test_a_sound_checkpoint_has_no_errors(walker, robot):
    findings = check_checkpoint(walker, robot)
    assert errors(findings) == []
    assert "none" in found(findings, "info", "golden vectors").message
    assert "no motors" in found(findings, "info", "robot").message


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
    finding = next(f for f in document["findings"] if f["field"] == "default_joint_pos")
    assert (finding["joint"], finding["value"], finding["limit"]) == ("right_knee", 2.5, 2.0)
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
    assert (finding.value, finding.limit) == (30, 32)
    assert "joint_pos_rel 12" in finding.message


def test_a_contract_that_cannot_be_is_a_finding(cli, walker, robot, tmp_path):
    walker.write_bytes(add_metadata(walker, {}))
    file = tmp_path / "negative.yaml"
    file.write_text("override: {joint_damping: [1, -2, 1, 1]}\n", encoding="utf-8")
    findings = check_checkpoint(walker, robot, file)
    assert len(findings) == 1
    assert "joint_damping" in found(findings, "error", "contract").message
    assert "right_hip" in findings[0].message
    assert cli("check", walker, "--robot", robot.mjcf_path, "--contract", file)[0] == 1


def _check_lite(tmp_path, lite, **changes):
    wiring = lite_contract(lite, **changes)
    model = save_model(tmp_path / "lite.onnx", wiring, len(wiring.joint_names))
    return check_checkpoint(model, lite)


def save_model(path, wiring, width):
    """A linear policy of `width` observations for a contract."""
    onnx.save(linear_model(write_metadata(wiring), inputs=width, outputs=wiring.action_count), str(path))
    return path


def test_gains_that_the_motors_cannot_encode(tmp_path, lite):
    damping, stiffness = np.full(14, 2.0), np.full(14, 50.0)
    damping[3], damping[6], stiffness[4] = 6.0, 0.001, 501.0
    findings = _check_lite(tmp_path, lite, joint_damping=damping, joint_stiffness=stiffness)
    finding = found(findings, "error", "joint_damping", "left_elbow_pitch")
    assert (finding.value, finding.limit) == (6.0, 5.0)
    assert finding.message == "is 6, but motor rs-00 encodes at most 5"
    finding = found(findings, "error", "joint_stiffness", "left_wrist_yaw")
    assert (finding.value, finding.limit) == (501.0, 500.0)
    steps = [f for f in findings if f.joint == "left_wrist_pitch" and "encodes in steps" in f.message]
    assert len(steps) == 1


def test_unstable_damping_names_joint_and_step(tmp_path, lite):
    model = save_model(tmp_path / "lite.onnx", lite_contract(lite), 14)
    assert errors(check_checkpoint(model, lite)) == []
    findings = check_checkpoint(model, lite, physics_timestep=0.004)
    unstable = [finding for finding in findings if "physics step" in finding.message]
    assert len(unstable) == 1
    assert unstable[0].severity == "error"
    assert "wrist" in unstable[0].joint
    assert "a step below" in unstable[0].message
    longest = float(unstable[0].message.partition("a step below ")[2].split()[0])
    assert errors(check_checkpoint(model, lite, physics_timestep=0.95 * longest)) == []


def test_poses_and_actions_beyond_the_joints(robot):
    wiring = contract(
        default_joint_pos=[-0.2, 0.1, 0.6, 0.5],
        action_scale=[2.0, 0.01, 0.3],
        action_offset=[0.5, -0.2, 1.9],
        position_clip=None,
    )
    findings = tuple(range_findings(wiring, robot))
    assert "ask for -1.5 to 2.5" in found(findings, "info", "action_scale", "right_knee").message
    assert "hardly moves" in found(findings, "warning", "action_scale", "left_hip").message
    assert found(findings, "error", "action_offset", "right_hip").limit == 1.5
    degrees = contract(default_joint_pos=[-20.0, 10.0, 0.6, 0.5])
    assert (
        "is it in degrees?" in found(range_findings(degrees, robot), "error", "default_joint_pos", "left_hip").message
    )
    wide = contract(position_clip=[[-1.0, 3.0]] * 3)
    assert "wider than" in found(range_findings(wide, robot), "warning", "position_clip", "right_knee").message


def test_gravity_that_points_up_stands_first(robot):
    terms = contract().terms
    upside_down = contract(
        observation=tuple(replace(term, scale=-1.0) if term.name == "projected_gravity" else term for term in terms),
        policy_dt=1.0,
    )
    findings = sorted_findings(suspicious_findings(upside_down, robot))
    assert str(findings[0]) == (
        "observation term projected_gravity: "
        "scale is -1: gravity would be fed as (0, 0, 1) when upright; almost always wrong"
    )
    assert "policy_dt" in [finding.field for finding in findings[1:]], "an equal that was found earlier"


def test_joints_that_only_their_places_tell_are_a_warning(robot):
    placed = contract(provenance={"joint_names": "deploy.yaml and the robot"})
    (finding,) = naming_findings(placed, robot)
    assert finding.severity == "warning"
    assert str(finding).startswith("joint_names: are those of 'walker' (deploy.yaml and the robot): nothing in the")
    assert list(naming_findings(contract(provenance={"joint_names": "mjlab metadata"}), robot)) == []
    assert list(naming_findings(contract(provenance={"joint_names": "robot's own order"}), robot)) != []


def test_hardware_needs_an_estimator_motors_and_a_rate(tmp_path, robot):
    wiring = contract(observation=[*terms()[:-1], Term("base_lin_vel")], policy_dt=0.03)
    model = save_model(tmp_path / "m.onnx", wiring, 33)
    model.write_bytes(add_metadata(model, {STAMP_KEY: encode(wiring)}))
    findings = check_checkpoint(model, robot, hardware=True)
    assert "no estimator" in found(findings, "error", "observation term base_lin_vel").message
    assert "no motors" in found(findings, "error", "robot").message
    assert any("no multiple" in finding.message for finding in findings if finding.field == "policy_dt")
    simulated = check_checkpoint(model, robot)
    assert "simulation knows" in found(simulated, "info", "observation term base_lin_vel").message


def test_the_models_answers(tmp_path, robot):
    path = save_checkpoint(tmp_path / "walker.onnx")
    model = onnx.load(str(path))

    def with_weights(weights):
        model.graph.initializer[0].raw_data = weights.astype(np.float32).tobytes()
        onnx.save(model, str(path))
        return check_checkpoint(path, robot)

    deaf = network().copy()
    deaf[3:6] = 0.0
    assert "no influence" in found(with_weights(deaf), "warning", "observation term projected_gravity").message
    assert "whatever it observes" in found(with_weights(0.0 * deaf), "warning", "model").message
    broken = network().copy()
    broken[0, 1] = np.inf  # 0 · infinity is not a number
    assert "not finite" in found(with_weights(broken), "error", "model", "left_hip").message


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
        assert f"observation term {term}: needs" in out
    assert "policy_dt: 0.02 s (50 Hz): assumed (mjlab)" in out
