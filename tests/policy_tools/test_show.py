"""`policy show`: one table of what is known and where it comes from, and what was found and not used."""

import re

import pytest
from published import G1, POLICIES, TRACES, contract_beside, needs_policies


def test_a_contract_is_one_table_and_a_replaced_value_stands_behind_its_replacement(cli, stamped):
    status, out, error = cli("show", stamped)
    assert (status, error) == (0, "")
    lines = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert "8 samples of the trainer's run (trace.npz)" in lines["golden"]
    assert "joint_pos_rel 12 + joint_vel_rel 4" in lines["observation"]
    assert "history 3 of joint_pos_rel" in " ".join(out.split())
    stamped.with_name("contract.yaml").write_text("policy_dt: 0.04\n")
    assert re.search(r"\npolicy_dt +0.04 .*contract.yaml \(replaces 0.02 .*\)", cli("show", stamped)[1])


@needs_policies
@pytest.mark.usefixtures("near_ends")
def test_published_policies(cli, tmp_path):
    rest = contract_beside("holosoma", tmp_path)
    for name, options, texts in (
        ("unitree", ("--robot", G1), ("deploy.yaml and the robot", "command_ranges")),
        ("waltz", (), ("assumed (mjlab)", "torso_link")),
        ("mjlab", (), ("at imu of base_lin_vel", "assumed (mjlab)")),
        ("holosoma", ("--contract", rest), ("holosoma metadata", "rest.yaml")),
    ):
        status, out, error = cli("show", POLICIES / TRACES[name][0], *options)
        assert (status, error) == (0, "")
        for text in texts:
            assert text in out
