"""Unitree's deploy.yaml: what its files in the wild hold, and what is refused."""

import numpy as np
import pytest
import yaml

from humanoid_sim.controllers.terms import HeightScan
from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.contract_yaml import parse_contract
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.sources import assumptions
from humanoid_sim.policy.readers.unitree import find_deploy, read_deploy

ROBOT = ("a", "b", "c", "d")

GOOD = {
    "joint_ids_map": [2, 0, 3, 1],
    "step_dt": 0.02,
    "stiffness": [10.0, 11.0, 12.0, 13.0],
    "damping": [1.0, 1.1, 1.2, 1.3],
    "default_joint_pos": [0.2, 0.0, 0.3, 0.1],
    "commands": {
        "base_velocity": {"ranges": {"lin_vel_x": [-1, 1], "lin_vel_y": [0, 0], "ang_vel_z": [-2, 2], "heading": None}}
    },
    "actions": {"JointPositionAction": {"clip": None, "joint_names": [".*"], "scale": [0.25] * 4, "offset": [0.0] * 4}},
    "observations": {
        "base_ang_vel": {"params": {}, "clip": None, "scale": [0.2, 0.2, 0.2], "history_length": 5},
        "joint_pos_rel": {"params": {}, "clip": [-10, 10], "scale": None, "history_length": 0},
        "gait_phase": {"params": {"period": 0.6}, "clip": None, "scale": [1.0, 1.0]},
    },
}


def written(path, **changes):
    path.write_text(yaml.safe_dump({**GOOD, **changes}, sort_keys=False))
    return path


def contract(path, **changes):
    return merge([read_deploy(written(path / "deploy.yaml", **changes))], "policy.onnx", ROBOT)


def observations(**changes):
    return {**GOOD["observations"], **changes}


def action(**changes):
    return {"JointPositionAction": {**GOOD["actions"]["JointPositionAction"], **changes}}


def test_gains_are_in_the_robots_order_and_the_rest_in_the_policys(tmp_path):
    made = contract(tmp_path)
    assert made.joint_names == ("c", "a", "d", "b")
    assert made.joint_stiffness.tolist() == [12.0, 10.0, 13.0, 11.0]
    assert made.joint_damping.tolist() == [1.2, 1.0, 1.3, 1.1]
    assert made.default_joint_pos.tolist() == [0.2, 0.0, 0.3, 0.1]


def test_terms(tmp_path):
    gyro, joints, phase = contract(tmp_path).terms
    assert (gyro.history, joints.history, phase.history) == (5, 1, 1)
    assert (gyro.clip, joints.clip) == (None, (-10.0, 10.0))
    assert np.asarray(gyro.scale).tolist() == [0.2, 0.2, 0.2]
    assert float(joints.scale) == 1.0


def test_a_gait_phase_brings_its_rule(tmp_path):
    rule = contract(tmp_path).phase
    assert rule.period == 0.6
    assert rule.offsets.tolist() == [0.0]
    assert rule.advance_first


def test_a_gait_phase_implies_that_its_clock_shows_nothing_while_the_robot_stands(tmp_path):
    made = contract(tmp_path)
    rule = made.phase
    assert (rule.standing_threshold, rule.standing_value, rule.standing_restarts) == (0.1, None, False)
    assert made.provenance["phase"] == "deploy.yaml"
    assert assumptions(made)[-1] == (
        "phase: offsets [0], standing_threshold 0.1, standing_value none, standing_restarts false, "
        "advance_first true: assumed (Unitree)"
    )


def test_commands(tmp_path):
    made = contract(tmp_path)
    assert made.command_names == ("base_velocity",)
    assert made.command_ranges.tolist() == [[-1.0, 1.0], [0.0, 0.0], [-2.0, 2.0]]
    terms = observations(motion_command={"params": {"command_name": "motion"}, "scale": None})
    made = contract(tmp_path, commands={}, observations=terms)
    assert (made.command_names, made.task_type, made.command_ranges) == (("motion",), "tracking", None)


@pytest.mark.parametrize(
    ("ids", "names", "driven"),
    [
        (None, [".*"], ("c", "a", "d", "b")),
        ([1, 3], [".*"], ("a", "b")),
        (None, ["[ab]"], ("a", "b")),
        (None, ["d", "c"], ("c", "d")),
    ],
)
def test_a_subset_of_the_joints_is_driven(tmp_path, ids, names, driven):
    n = len(driven)
    changed = action(joint_ids=ids, joint_names=names, scale=[0.5] * n, offset=[0.1] * n)
    made = contract(tmp_path, actions=changed)
    assert made.action_joint_names == driven
    assert made.action_scale.tolist() == [0.5] * n


SLICE = """
observations:
  joint_vel_rel:
    scale: 0.05
    params:
      asset_cfg: {name: robot, joint_ids: !!python/object/apply:builtins.slice [%s]}
"""


@pytest.mark.parametrize(
    ("bounds", "joints"),
    [("null, null, null", None), ("0, 2, null", ("c", "a")), ("null, null, -1", ("b", "d", "a", "c"))],
)
def test_a_python_slice_is_read_without_calling_python(tmp_path, bounds, joints):
    path = tmp_path / "deploy.yaml"
    rest = {key: value for key, value in GOOD.items() if key != "observations"}
    path.write_text(yaml.safe_dump(rest) + SLICE % bounds)
    assert merge([read_deploy(path)], "policy.onnx", ROBOT).terms[0].joints == joints


def test_history_by_steps(tmp_path):
    terms = {name: {**term, "history_length": 3} for name, term in GOOD["observations"].items()}
    assert contract(tmp_path, observations={"use_gym_history": True, **terms}).history_layout == "per_step"
    assert contract(tmp_path, observations=terms).history_layout == "per_term"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_ids_map": [0, 0]}, "joint_ids_map is [0, 0], expected places on the robot"),
        ({"joint_ids_map": [-1, 0]}, "joint_ids_map is [-1, 0], expected places on the robot"),
        ({"joint_ids_map": "all"}, "joint_ids_map is all, expected a list"),
        ({"step_dt": "50 Hz"}, "step_dt is 50 Hz, expected a number"),
        ({"stiffness": [1, "x"]}, "stiffness is [1, 'x'], expected a number, or a list of numbers"),
        (
            {"stiffness": [1.0, 2.0]},
            "stiffness is 2 values, expected 4 values, as joint_ids_map leads to place 3, or 4",
        ),
        ({"commands": [1]}, "commands is [1], expected a mapping"),
        (
            {"commands": {"base_velocity": {"ranges": {"lin_vel_x": [0]}}}},
            "commands.base_velocity.ranges.lin_vel_x is [0], expected [least, greatest]",
        ),
        (
            {"actions": {"JointVelocityAction": {}}},
            "actions is JointVelocityAction, expected JointPositionAction alone",
        ),
        ({"actions": action(clip=[[1]])}, "actions.JointPositionAction.clip[0] is [1], expected [least, greatest]"),
        ({"actions": action(joint_ids=[0.5])}, "actions.JointPositionAction.joint_ids is [0.5], expected a slice, or"),
        ({"observations": {"a": {"scale": "x"}}}, "observations.a.scale is x, expected a number, or a list of numbers"),
        ({"observations": {"a": {"clip": 1}}}, "observations.a.clip is 1, expected [least, greatest]"),
        ({"observations": {"a": {"history_length": -1}}}, "observations.a.history_length is -1, expected a whole"),
        ({"observations": {"gait_phase": {"params": {"period": 0}}}}, "observations.gait_phase.params.period: is 0"),
        (
            {"observations": {"use_gym_history": 1, "a": {}}},
            "observations.use_gym_history is 1, expected true or false",
        ),
        (
            {"observations": {"policy": {"a": {}}, "critic": {"b": {}}}},
            "observations is the groups policy, critic, expected one group of terms, for one input",
        ),
        (
            {"observations": {"scale_first": True, "a": {"clip": [0, 1], "scale": [1.0, 2.0]}}},
            "observations.a.scale is [1. 2.], expected one positive factor, as scale_first clips after it",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_place(tmp_path, changes, message):
    path = written(tmp_path / "deploy.yaml", **changes)
    with pytest.raises(InputError) as caught:
        read_deploy(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)


def test_where_the_file_lies(tmp_path):
    model = tmp_path / "exported" / "policy.onnx"
    (tmp_path / "exported").mkdir()
    (tmp_path / "params").mkdir()
    assert find_deploy(model) is None
    (tmp_path / "params" / "deploy.yaml").touch()
    assert find_deploy(model) == tmp_path / "params" / "deploy.yaml"
    assert find_deploy(tmp_path / "policy.onnx") == tmp_path / "params" / "deploy.yaml"
    (tmp_path / "exported" / "deploy.yaml").touch()
    assert find_deploy(model) == tmp_path / "exported" / "deploy.yaml"


def test_names_that_the_robot_lacks_show_that_it_is_another_one(tmp_path):
    assert contract(tmp_path, actions=action(joint_names=["[ab]", "c|d"])).joint_names == ("c", "a", "d", "b")
    terms = observations(joint_pos_rel={"params": {"asset_cfg": {"joint_names": ["left_knee"]}}})
    for changes in ({"actions": action(joint_names=["[abcd]", "left_knee"])}, {"observations": terms}):
        with pytest.raises(InputError) as caught:
            contract(tmp_path, **changes)
        assert str(caught.value) == (
            "policy.onnx: joint_names: deploy.yaml names 'left_knee', and no joint of this robot is called so: "
            "is the policy for another robot? this one has c, a, d, b"
        )
    # Where another source names the joints, they are the robot's by name, and are compared as such.
    named = parse_contract({"joint_names": list("abcd")}, "contract.yaml", "contract.yaml")
    read = read_deploy(written(tmp_path / "deploy.yaml", observations=terms))
    assert merge([read, *named], "policy.onnx", ROBOT).joint_names == ("a", "b", "c", "d")


def test_a_height_scan_is_isaac_labs(tmp_path):
    term = {"params": {"sensor_cfg": {"name": "height_scanner"}}, "clip": [-1.0, 1.0], "scale": None}
    made = contract(tmp_path, observations=observations(height_scanner=term))
    assert made.terms[-1].kind == "height_scan"
    assert made.terms[-1].clip == (-1.0, 1.0)
    scan = made.height_scan
    assert scan == HeightScan("torso_link", (1.6, 1.0), 0.1, "xy", offset=0.5, range=1e6, miss=-1e6, above=20.0), (
        "a ray that hits nothing is -1 after the clip, as minus infinity is"
    )
    assert made.provenance["observation.height_scanner.offset"] == "assumed (Isaac Lab)"
    term["params"]["offset"] = 0.3
    made = contract(tmp_path, observations=observations(height_scanner=term))
    assert made.height_scan.offset == 0.3
    assert made.provenance["observation.height_scanner.offset"] == "deploy.yaml"
