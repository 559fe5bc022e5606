"""Published G1 policies through `play`, against the figures measured with them in plain MuJoCo (their READMEs)."""

import pytest
from published import G1, POLICIES, TRACES, contract_beside, needs_policies

pytestmark = needs_policies

UNITREE, WALTZ, HOLOSOMA = (str(POLICIES / TRACES[name][0]) for name in ("unitree", "waltz", "holosoma"))


def walk(run, policy, *options, seconds):
    script = f"damp; load_a; wait; start_locomotion; {'motion' if seconds == 0 else f'hold {seconds}'}; damp"
    return run("--policy", policy, "--robot", str(G1), "--script", script, *options)


def test_the_unitree_policy_walks(run):
    result = walk(run, UNITREE, "--command", "0.5,0,0", seconds=6)
    assert result.status == 0
    base = result.summary["base"]
    assert base["fall"] is None
    assert base["velocity"][0] == pytest.approx(0.427, abs=0.03)
    released = [event.text for event in result.events if "support" in event.text]
    assert released == ["support released", "support holds the base where it is"]


def test_the_waltz_is_danced(run):
    result = walk(run, WALTZ, "--duration", "8", seconds=0)
    assert result.status == 0
    errors = result.summary["tracking"]["errors"]
    assert errors["joint_error"]["mean"] <= 0.11
    assert errors["anchor_position_error"]["max"] <= 0.3
    assert "assumed" in result.out


def test_the_holosoma_policy_walks(run, tmp_path):
    options = ("--contract", str(contract_beside("holosoma", tmp_path)), "--command", "0.5,0,0")
    result = walk(run, HOLOSOMA, *options, seconds=6)
    assert result.status == 0
    assert result.summary["base"]["fall"] is None
    assert result.summary["base"]["velocity"][0] == pytest.approx(0.393, abs=0.04)
