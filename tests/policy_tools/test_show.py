"""`policy show`: one table of what is known and where it comes from, and what was found and not used."""

import re


def test_a_contract_is_one_table_and_a_replaced_value_stands_behind_its_replacement(cli, stamped):
    status, out, error = cli("show", stamped)
    assert (status, error) == (0, "")
    lines = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert "8 samples of the trainer's run (trace.npz)" in lines["golden"]
    assert "joint_pos_rel 12 + joint_vel_rel 4" in lines["observation"]
    assert "history 3 of joint_pos_rel" in " ".join(out.split())
    stamped.with_name("contract.yaml").write_text("policy_dt: 0.04\n")
    assert re.search(r"\npolicy_dt +0.04 .*contract.yaml \(replaces 0.02 .*\)", cli("show", stamped)[1])
