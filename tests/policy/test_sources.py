"""Which sources speak about a checkpoint, and those that a contract.yaml leaves out."""

import pytest
import yaml
from test_mjlab import WALKER

from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.sources import assemble_contract


def folder(path, deploy, **contract):
    (path / "deploy.yaml").write_text(deploy, encoding="utf-8")
    (path / "contract.yaml").write_text(yaml.safe_dump({"phase": {"period": 0.6}, **contract}), encoding="utf-8")
    return path / "policy.onnx"


def test_an_override_decides_between_the_metadata_and_the_file_beside_it(tmp_path):
    model = folder(tmp_path, "step_dt: 0.02\nstiffness: [1, 2]\n", override={"joint_stiffness": 30.0})
    contract = assemble_contract(model, WALKER)
    assert contract.joint_stiffness.tolist() == [30.0, 30.0]


def test_a_source_that_is_ignored_is_not_even_read(tmp_path):
    model = folder(tmp_path, "step_dt: fast\n", ignore=["deploy.yaml"])
    contract = assemble_contract(model, WALKER)
    assert contract.policy_dt == 0.02
    assert "deploy.yaml" not in contract.provenance.values()


def test_metadata_can_be_ignored(tmp_path):
    model = folder(tmp_path, "step_dt: 0.05\n", ignore=["mjlab metadata"])
    with pytest.raises(InputError, match=r"the contract lacks joint_names, .*; read: deploy\.yaml \(policy_dt\); "):
        assemble_contract(model, WALKER)


def test_a_source_that_is_not_there_cannot_be_ignored(tmp_path):
    model = folder(tmp_path, "step_dt: 0.02\n", ignore=["deploy.yml"])
    message = (
        r"contract\.yaml: ignore: unknown source 'deploy\.yml' \(did you mean 'deploy\.yaml'\?\); "
        r"known: mjlab metadata, deploy\.yaml$"
    )
    with pytest.raises(InputError, match=message):
        assemble_contract(model, WALKER)
