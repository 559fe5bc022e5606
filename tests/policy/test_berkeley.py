"""Berkeley Humanoid Lite's deployment YAML: what its files in the wild hold, where they lie, and what is refused."""

import pytest
import yaml
from published import POLICIES, needs_policies

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.readers.berkeley import find_berkeley, read_berkeley
from humanoid_sim.policy.readers.merge import merge

JOINTS = ["arm", "hip", "knee"]
GOOD = {
    "policy_checkpoint_path": "checkpoints/legs.onnx",
    "policy_dt": 0.04,
    "num_joints": 3,
    "joints": JOINTS,
    "joint_kp": [10.0, 20.0, 30.0],
    "joint_kd": 2,
    "effort_limits": [4.0, 6.0, 6.0],
    "default_joint_positions": [0.0, -0.2, 0.4],
    "num_observations": 15,
    "history_length": 0,
    "num_actions": 2,
    "action_scale": 0.25,
    "action_indices": [1, 2],
    "action_limit_lower": -200,
    "action_limit_upper": 200,
}


def written(path, **changes):
    path.parent.mkdir(parents=True, exist_ok=True)
    document = {key: value for key, value in (GOOD | changes).items() if value is not ...}
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def contract(folder, robot=None, **changes):
    return merge([read_berkeley(written(folder / "legs.yaml", **changes))], "legs.onnx", robot)


def test_what_the_file_says(tmp_path):
    made = contract(tmp_path)
    assert made.joint_names == ("arm", "hip", "knee")
    assert made.action_joint_names == ("hip", "knee")
    assert (made.joint_stiffness.tolist(), made.joint_damping.tolist()) == ([10.0, 20.0, 30.0], [2.0, 2.0, 2.0])
    assert made.default_joint_pos.tolist() == [0.0, -0.2, 0.4]
    assert made.effort_limit.tolist() == [4.0, 6.0, 6.0]
    assert (made.action_scale.tolist(), made.policy_dt) == ([0.25, 0.25], 0.04)
    assert (made.action_clip, made.action_limit) == (200.0, 10_000.0)
    assert made.provenance["action_limit"] == "assumed (Berkeley Humanoid Lite)"


def test_the_terms_come_with_the_dialect(tmp_path):
    made = contract(tmp_path)
    assert [term.kind for term in made.terms] == [
        "velocity_command",
        "base_ang_vel",
        "projected_gravity",
        "joint_pos",
        "joint_vel",
        "actions",
    ]
    assert made.terms[3].joints == made.terms[4].joints == ("hip", "knee")
    assert contract_layout(made, None).width == GOOD["num_observations"]
    longer = contract(tmp_path, history_length=2)
    assert {term.history for term in longer.terms} == {3}
    assert longer.history_layout == "per_step"


def test_a_file_of_another_kind_is_not_taken_for_one(tmp_path):
    (tmp_path / "legs.yaml").write_text("joint_kp: 3\n", encoding="utf-8")
    assert find_berkeley(tmp_path / "legs.onnx") is None
    (tmp_path / "legs.yaml").write_text("{", encoding="utf-8")
    assert find_berkeley(tmp_path / "legs.onnx") is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_kp": [1.0, 2.0]}, r"joint_kp is \[1\.0, 2\.0\], expected a number, or 3 of them"),
        ({"joints": ["hip"]}, "joints is .*, expected 3 names, as num_joints says"),
        ({"action_indices": [1, 3]}, r"action_indices is \[1, 3\], expected places of joints, 0 to 2, none twice"),
        ({"action_limit_lower": -1}, r"action_limit_lower, action_limit_upper is \[-1, 200\], expected -x and x"),
        ({"history_length": -1}, "history_length is -1, expected a whole number >= 0"),
        ({"policy_dt": "fast"}, "policy_dt is fast, expected a number"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, changes, message):
    with pytest.raises(InputError, match=rf"^{tmp_path}/legs\.yaml: {message}"):
        contract(tmp_path, **changes)


@needs_policies
def test_the_published_checkpoint_needs_nothing_else():
    checkpoint = load_checkpoint(POLICIES / "berkeley_humanoid_lite_biped_50hz/checkpoints/policy_biped_50hz.onnx")
    layout = checkpoint.following().layout
    assert (layout.width, checkpoint.observation_width) == (45, 45)
    assert checkpoint.contract.effort_limit.tolist() == [5.0] * 12
    assert checkpoint.contract.policy_dt == 0.02
