"""The training examples: a few iterations end with a policy that passes `check` and runs in `play`."""

import subprocess
import sys
from pathlib import Path

import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy_tools import main

pytestmark = pytest.mark.peers

EXAMPLES = Path(__file__).parents[2] / "examples"
QUICK = ("--iterations", "2", "--envs", "8", "--minutes", "1")


@pytest.mark.parametrize(
    ("example", "robot", "options"),
    [
        ("train_walking", "lite_biped", ("--command", "0.3,0,0")),
        ("train_tracking", "lite", ("--motion", "wave")),
    ],
)
def test_a_few_iterations_end_with_a_policy_that_plays(example, robot, options, folder, run):
    policy = folder / "policy.onnx"
    command = [sys.executable, str(EXAMPLES / f"{example}.py"), "--output", str(policy), *QUICK]
    subprocess.run(command, check=True)
    assert run_program(main, ["check", str(policy), "--robot", robot]) == 0
    assert "trainer's run" in load_checkpoint(policy).golden
    script = "damp; load_a; wait; start_locomotion; hold 0.4; damp"
    result = run("--robot", robot, "--policy", str(policy), *options, "--script", script)
    assert result.status == 0, result.err
    assert "LOCOMOTION" in {tick.output.control_mode.mode.name for tick in result.ticks}
