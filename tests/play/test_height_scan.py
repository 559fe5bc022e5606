"""A policy that observes the ground: rays in simulation, a recording that replays, and a program on a robot."""

from dataclasses import replace

import numpy as np
from models import linear_model, saved

from humanoid_sim import replay
from humanoid_sim.assets import policy_path
from humanoid_sim.cli import run_program
from humanoid_sim.controllers.contract import HeightScan, Term
from humanoid_sim.messages import Mode
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.readers.own import STAMP_KEY, encode, write_metadata

SCAN = Term("height_scan", scan=HeightScan(grid=(0.4, 0.2), resolution=0.2), scale=0.5)


def seeing(path):
    """A policy with the sample policy's wiring that observes the ground alone."""
    sample = load_checkpoint(policy_path("lite_tracking")).contract
    contract = replace(sample, task_type="locomotion", observation=(SCAN,), body_names=())
    metadata = {**write_metadata(contract), STAMP_KEY: encode(contract)}
    width = contract_layout(contract).width
    return saved(path, linear_model(metadata, inputs=width, outputs=contract.action_count))


def test_play_makes_it_records_it_and_replays_it(run, quick, folder):
    policy = seeing(folder / "seeing.onnx")
    script = "damp; load_a; wait; start_locomotion; hold 0.1; damp"
    result = run("--robot", quick, "--policy", str(policy), "--script", script, "--html", "none")
    assert result.status == 0, result.err
    walking = [tick for tick in result.ticks if tick.output.control_mode.mode is Mode.LOCOMOTION]
    assert walking
    for tick in walking:
        scan = tick.input.state.extern["height_scan"]
        assert scan.value.shape == (6,)
        assert scan.arrival_time == tick.input.state.time
        step = tick.output.policy_step
        if step is not None:
            np.testing.assert_array_equal(step.observation, (0.5 * scan.value).astype(np.float32))
    heights = np.array([tick.input.state.extern["height_scan"].value for tick in walking])
    assert 0.3 < heights.min() <= heights.max() < 1.0
    assert run_program(replay.main, ["r.mcap"]) == 0
