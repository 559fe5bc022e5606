"""The baseline that ships with the velocity suite, of the shipped policy for the Lite's legs."""

import json
from hashlib import sha256

import pytest

from humanoid_sim.assets import WALKING_POLICY, asset_path
from humanoid_sim.regress import main

BASELINE = asset_path("suites", "velocity.lite_biped.json")


def test_it_is_of_the_shipped_policy():
    baseline = json.loads(BASELINE.read_bytes())
    assert baseline["sha256"] == sha256(WALKING_POLICY.read_bytes()).hexdigest()
    assert len(baseline["episodes"]) == 96
    assert sum(bool(episode["failure"]) for episode in baseline["episodes"]) == 3


@pytest.mark.soak
def test_the_shipped_policy_passes_against_it(capsys):
    arguments = ["--suite", "velocity", "--robot", "lite_biped", "--baseline", str(BASELINE), "--only", "forward"]
    assert main([str(WALKING_POLICY), *arguments, "--quiet"]) == 0
    assert capsys.readouterr().out.startswith("PASS lite_biped_velocity")
