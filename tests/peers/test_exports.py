"""Policies as mjlab 1.6 and rsl_rl 5 export them: read, checked, proved by runs of mjlab's own environment, played."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim import prepare
from humanoid_sim.cli import run_program
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.policy.onnx_policy import read_metadata

pytestmark = pytest.mark.peers

KNOWN = json.loads((Path(__file__).parents[1] / "data" / "mjlab_metadata.json").read_text(encoding="utf-8"))
IMU = "observation.base_lin_vel.at"
ASSUMED = {
    "velocity_flat": {IMU},
    "velocity_rough": {IMU, "observation.height_scan.scan"},
    "tracking": {IMU, "reference_quaternion"},
    "tracking_no_state_estimation": {"reference_quaternion"},
}
"""By task what its files leave open, and the dialect fills in; the rate is in `params/env.yaml`."""


@dataclass(frozen=True)
class Export:
    """One task's files."""

    model: Path
    golden: Path

    @property
    def robot(self):
        return self.golden / "scene.xml"

    def wired(self, contract=None):
        return (self.model, "--robot", self.robot, "--contract", contract or self.golden / "contract.yaml")

    @property
    def trace(self):
        return self.golden / "trace.npz"


@pytest.fixture(params=ASSUMED)
def task(request):
    return str(request.param)


@pytest.fixture
def export(exports, task):
    return Export(exports / task / f"{task}.onnx", exports / task / "golden")


@pytest.mark.parametrize("task", KNOWN)
def test_the_metadata_is_what_the_other_tests_take_for_mjlabs(exports, task):
    assert read_metadata(exports / task / f"{task}.onnx") == KNOWN[task]


def test_nothing_is_missing_that_mjlab_knows(export, task):
    source = load_checkpoint(export.model).contract.source
    assert {name for name, origin in source.items() if origin.startswith("assumed")} == ASSUMED[task]
    for field in ("action_scale", "joint_stiffness"):
        assert source[field] == "env.yaml (mjlab metadata has it rounded)"
    assert source["policy_dt"] == "env.yaml"
    source = load_checkpoint(export.model, export.golden / "contract.yaml").contract.source
    assert source["joint_stiffness"] == "contract.yaml"


def test_no_error_is_found(cli, export):
    for wiring in ((export.model, "--robot", export.robot), export.wired()):
        status, out, error = cli("check", *wiring)
        assert (status, error) == (0, ""), out
        assert "0 error(s)" in out
    assert "as exporters round" not in out
    assert "no torque limit" not in out


def test_every_step_of_mjlabs_run_is_computed_again(cli, export, task, tmp_path):
    with np.load(export.trace) as trace:
        assert len(trace["obs"]) == len(trace["target"]) == 60
        assert (np.ptp(trace["obs"], axis=0) > 0.0).mean() > 0.95, "the run moves what the policy observes"
    stamped = tmp_path / "stamped.onnx"
    status, _, error = cli("stamp", *export.wired(), "--trace", export.trace, "--output", stamped)
    assert (status, error) == (0, "")
    assert load_checkpoint(stamped).golden == "8 samples of the trainer's run (trace.npz)"


def test_without_the_exact_numbers_the_rounding_is_named(cli, export, tmp_path):
    output, alone = tmp_path / "x.onnx", tmp_path / "alone.onnx"  # without the env.yaml beside it, which has them
    shutil.copy(export.model, alone)
    status, _, error = cli("stamp", alone, "--robot", export.robot, "--trace", export.trace, "--output", output)
    assert status == 2
    assert "target of " in error
    assert "action_scale was rounded in export" in error
    assert not output.exists()


def test_it_is_played(run, export):
    script = "damp; load_a; wait; start_locomotion; hold 0.4; damp"
    wiring = [str(part) for part in export.wired()[1:]]
    result = run("--policy", str(export.model), *wiring, "--script", script)
    assert result.status == 0
    steps = [tick for tick in result.ticks if tick.output.control_mode.mode.name == "LOCOMOTION"]
    assert len(steps) >= 80, "0.4 s at 200 Hz"


def test_rsl_rls_own_export_needs_what_it_does_not_say(cli, exports, tmp_path):
    """The network of the flat task, without metadata and with its tensors in a file beside it."""
    flat = exports / "velocity_flat"
    export = Export(exports / "rsl_rl" / "policy.onnx", flat / "golden")
    status, out, _ = cli("show", export.model)
    assert status == 1
    assert "lacks joint_names, joint_stiffness, joint_damping, default_joint_pos, observation, action_scale" in out
    said = KNOWN["velocity_flat"]
    terms = said["observation_names"].replace("base_lin_vel", "{name: base_lin_vel, at: imu}")
    rest = tmp_path / "rest.yaml"
    rest.write_text(
        (export.golden / "contract.yaml").read_text(encoding="utf-8")
        + f"joint_names: [{said['joint_names']}]\nobservation: [{terms}]\ncommand_names: [twist]\n",
        encoding="utf-8",
    )
    status, out, error = cli("check", *export.wired(rest))
    assert (status, error) == (0, ""), out
    stamped = tmp_path / "stamped.onnx"
    status, _, error = cli("stamp", *export.wired(rest), "--trace", export.trace, "--output", stamped)
    assert (status, error) == (0, "")
    own, other = load_checkpoint(stamped), load_checkpoint(flat / "velocity_flat.onnx")
    with np.load(export.trace) as trace:
        for observation in trace["obs"]:
            answers = [checkpoint.policy(observation, 0) for checkpoint in (own, other)]
            np.testing.assert_allclose(*answers, atol=1e-5)


def test_mjlabs_motion_is_prepared(exports, tmp_path, capsys):
    """The `motion.npz` of mjlab's own converter belongs to the robot of its scene, body by body."""
    tracking = exports / "tracking"
    files = ("--policy", tracking / "tracking.onnx", "--motion", exports / "motion.npz")
    where = ("--robot", tracking / "golden" / "scene.xml", "--output", tmp_path / "prepared")
    assert run_program(prepare.main, [str(part) for part in (*files, *where)]) == 0, capsys.readouterr().err
    assert read_motion(tmp_path / "prepared" / "motion.mcap").body_names[0] == "pelvis"
