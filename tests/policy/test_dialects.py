"""What each dialect says of a contract is read back as it was; permuted joints mean the same on the robot."""

from dataclasses import replace

import dialects
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.controllers.observation import pack, resolve_observation
from humanoid_sim.controllers.policy_step import action_command, resolve_action
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.term_values import ObservationContext
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, MITState
from humanoid_sim.policy.contract_json import STAMP_KEY, decode, encode
from humanoid_sim.policy.readers.contract_yaml import read_contract_file
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.sources import assemble_contract, metadata_contract
from humanoid_sim.policy.readers.unitree import read_deploy

NOT_IN_MJLAB = ("policy_dt", "action_offset", "position_clip", "history_layout", "command_ranges")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("dialects")


@given(dialects.contracts())
def test_json_keeps_every_bit(contract):
    text = encode(contract)
    again = decode(text, "here")
    assert encode(again) == text
    assert again.provenance == contract.provenance
    assert again.joint_stiffness.tobytes() == contract.joint_stiffness.tobytes()


@given(dialects.contracts())
def test_a_stamp_says_it_all(contract):
    again = merge(metadata_contract({STAMP_KEY: encode(contract)}, "here"), "here")
    assert dialects.said(again) == dialects.said(contract)


@given(dialects.contracts())
def test_contract_yaml_says_it_all(folder, contract):
    path = folder / "contract.yaml"
    path.write_text(dialects.through_yaml(dialects.as_contract_yaml(contract)), encoding="utf-8")
    again = merge(read_contract_file(path), "here")
    assert dialects.said(again) == dialects.said(contract)
    assert set(again.provenance.values()) == {"contract.yaml"}


@given(dialects.walkers())
def test_deploy_yaml(folder, contract):
    path = folder / "deploy.yaml"
    path.write_text(dialects.through_yaml(dialects.as_deploy(contract)))
    again = merge([read_deploy(path)], "here", dialects.ROBOT)
    assert dialects.said(again) == dialects.said(contract)


@given(dialects.walkers())
def test_mjlab_metadata(contract):
    again = merge(metadata_contract(dialects.as_mjlab(contract), "here"), "here")
    assert dialects.said(again, *NOT_IN_MJLAB) == dialects.said(contract, *NOT_IN_MJLAB)
    assert (again.policy_dt, again.provenance["policy_dt"]) == (0.02, "assumed (mjlab)")


@given(dialects.walkers())
def test_holosoma_metadata_with_the_rest_in_a_contract_yaml(folder, contract):
    metadata = dialects.as_holosoma(contract)
    rest = dialects.as_contract_yaml(contract)
    for field in ("joint_names", "joint_stiffness", "joint_damping", "command_ranges", "action_scale"):
        del rest[field]
    path = folder / "rest.yaml"
    path.write_text(dialects.through_yaml(rest))
    again = merge([*metadata_contract(metadata, "here"), *read_contract_file(path)], "here")
    assert dialects.said(again) == dialects.said(contract)
    assert again.provenance["joint_stiffness"] == "holosoma metadata"
    assert again.provenance["default_joint_pos"] == "rest.yaml"


@given(dialects.walkers(), st.randoms(use_true_random=False))
def test_permuted_joints_are_the_same_robot(contract, random):
    """The policy sees its joints in its own order and drives the same motors, in whichever order it names them."""
    order = list(range(len(contract.joint_names)))
    random.shuffle(order)
    permuted = permute(contract, order)
    rng = np.random.default_rng(0)
    n = len(dialects.ROBOT)
    state = MITState(
        0.0, *rng.normal(size=(3, n)), np.zeros(n), [1, 0, 0, 0], rng.normal(size=3), [0, 0, 9.81],
        {VELOCITY_COMMAND: Extern([0.1, 0.2, 0.3], 0.0)},
    )  # fmt: skip
    action = rng.normal(size=n).astype(np.float32)
    seen, moved = [], []
    for each, raw in ((contract, action), (permuted, action[order])):
        layout = resolve_observation(each, dialects.ROBOT, no_reference(), {VELOCITY_COMMAND: 3})
        packed = pack(layout, ObservationContext(state, raw, no_reference(), 0))
        seen.append({term.name: packed[term.start : term.stop] for term in layout.terms})
        moved.append(action_command(resolve_action(each, dialects.ROBOT), raw))
    for field in ("position", "stiffness", "damping"):
        assert getattr(moved[0], field).tobytes() == getattr(moved[1], field).tobytes(), field
    for name, values in seen[0].items():
        expected = values[order] if name in ("joint_pos_rel", "joint_vel_rel", "last_action") else values
        assert seen[1][name].tobytes() == expected.tobytes(), name


def permute(contract, order):
    joints = tuple(contract.joint_names[i] for i in order)
    terms = [
        replace(term, scale=np.asarray(term.scale)[order]) if np.size(term.scale) == len(order) else term
        for term in contract.terms
    ]
    return replace(
        contract,
        joint_names=joints,
        action_joint_names=joints,
        joint_stiffness=contract.joint_stiffness[order],
        joint_damping=contract.joint_damping[order],
        default_joint_pos=contract.default_joint_pos[order],
        action_scale=contract.action_scale[order],
        action_offset=contract.action_offset[order],
        position_clip=None if contract.position_clip is None else contract.position_clip[order],
        observation=terms,
    )


def test_a_whole_checkpoint_folder(tmp_path):
    """Unitree's folders: exported/policy.onnx, params/deploy.yaml; a contract.yaml overrides one field."""
    contract = dialects.a_walker()
    (tmp_path / "exported").mkdir()
    (tmp_path / "params").mkdir()
    (tmp_path / "params" / "deploy.yaml").write_text(dialects.through_yaml(dialects.as_deploy(contract)))
    (tmp_path / "exported" / "policy.contract.yaml").write_text("override: {action_scale: 1.0}\n")
    made = assemble_contract(tmp_path / "exported" / "policy.onnx", {}, None, dialects.ROBOT)
    assert made.action_scale.tolist() == [1.0] * 5
    assert made.provenance["action_scale"] == "policy.contract.yaml override"
    assert made.provenance["joint_stiffness"] == "deploy.yaml"
    assert made.provenance["joint_names"] == "deploy.yaml and the robot"
    assert dialects.said(made, "action_scale") == dialects.said(contract, "action_scale")
