"""What each dialect says of a contract, on files as its exporter writes them."""

import json

import numpy as np
import pytest
import yaml

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import read_checkpoint

ROBOT = ("a", "b", "c", "d")

MJLAB = {
    "joint_names": "hip,knee",
    "joint_stiffness": "40.179,99.098",
    "joint_damping": "2.558,6.309",
    "default_joint_pos": "0.100,0.200",
    "action_scale": "0.548,0.351",
    "command_names": "twist",
    "observation_names": "base_lin_vel,command,joint_pos,actions",
    "observation_terms_scale": "1.000,1.000;1.000;2.000,0.500,1.000",
    "observation_terms_clip": "-inf;inf,-inf;inf,-5.000;5.000,-inf;inf",
    "observation_terms_history_length": "0.000,0.000,5.000,0.000",
    "observation_terms_flatten_history_dim": "1.000,1.000,1.000,1.000",
    "run_path": "logs/run",
}


def read(path, metadata=None, robot=ROBOT):
    return read_checkpoint(path / "policy.onnx", metadata or {}, None, robot)


def test_mjlabs_metadata(tmp_path):
    more = {f"wandb_{i}": "x" for i in range(9)}
    reading = read(tmp_path, {**MJLAB, **more, "observation_term_clip": "[-inf, inf]"})
    contract = reading.contract
    velocity, command, positions, _ = contract.terms
    assert (velocity.at, command.scale.tolist(), positions.history) == ("imu", [1.0, 1.0, 2.0], 5)
    assert (positions.clip, float(positions.scale)) == ((-5.0, 5.0), 0.5)
    assert (contract.policy_dt, reading.source["policy_dt"]) == (0.02, "assumed (mjlab)")
    (line,) = reading.unused  # keys that mjlab does not write, the likely mistake first
    assert "'observation_term_clip'" in line
    assert "'observation_terms_clip'" in line
    assert "and 7 more" in line


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_stiffness": "40,x"}, "joint_stiffness is '40,x', expected numbers separated by commas"),
        ({"observation_terms_scale": "1.000"}, "observation_terms_scale has 1 entries, expected 4"),
    ],
)
def test_mjlabs_metadata_that_is_wrong(tmp_path, changes, message):
    with pytest.raises(InputError, match=rf"policy\.onnx: {message}"):
        read(tmp_path, {**MJLAB, **changes})


def test_lists_as_python_or_json_writes_them_are_read_too(tmp_path):
    listed = {key: str(MJLAB[key].split(",")) for key in ("joint_names", "joint_stiffness")}
    expected = read(tmp_path, MJLAB).contract
    contract = read(tmp_path, {**MJLAB, **listed}).contract
    assert contract.joint_names == expected.joint_names
    assert contract.joint_stiffness.tolist() == expected.joint_stiffness.tolist()


def test_mjlabs_clock_and_scan(tmp_path):
    metadata = {key: value for key, value in MJLAB.items() if not key.startswith("observation_terms")}
    (tmp_path / "contract.yaml").write_text("phase: {period: 0.6}\n")
    contract = read(tmp_path, {**metadata, "observation_names": "height_scan,phase"}).contract
    rule = contract.phase
    assert contract.height_scan == HeightScan()
    assert (rule.period, rule.standing_value, rule.standing_restarts, rule.advance_first) == (0.6, None, False, False)


HOLOSOMA = {
    "dof_names": '["left", "right"]',
    "kp": "[40.0, 50.0]",
    "kd": "[2.0, 2.5]",
    "command_ranges": '{"lin_vel_x": [-1, 1], "lin_vel_y": [0, 0], "ang_vel_yaw": [-2, 2], "heading": [0, 1]}',
}
EXPERIMENT = """
robot:
  init_state: {default_joint_angles: {left: 0.5}}
  dof_effort_limit_list: [80.0, 25.0]
  control: {action_scale: 0.25, action_scales_by_effort_limit_over_p_gain: true, clip_actions: true,
            action_clip_value: 100.0, clip_torques: true}
simulator: {config: {sim: {fps: 200, control_decimation: 4}}}
observation:
  groups:
    actor_obs: {history_length: 1, terms: {sin_phase: {scale: 1}, dof_pos: {scale: 1}, base_ang_vel: {scale: 0.25}}}
command: {setup_terms: {locomotion_gait: {params: {gait_period: 1.0}}}}
"""


def test_holosomas_metadata_with_its_experiment(tmp_path):
    experiment = json.dumps(yaml.safe_load(EXPERIMENT))
    contract = read(tmp_path, {**HOLOSOMA, "experiment_config": experiment, "robot_urdf": "<robot/>"}).contract
    assert contract.observation_names == ("base_ang_vel", "dof_pos", "sin_phase")  # holosoma sorts them
    assert contract.default_joint_pos.tolist() == [0.5, 0.0]
    assert contract.action_scale.tolist() == [0.5, 0.125]
    assert (contract.action_clip, contract.policy_dt, contract.effort_limit.tolist()) == (100.0, 0.02, [80.0, 25.0])
    assert contract.command_ranges.tolist() == [[-1, 1], [0, 0], [-2, 2]]
    assert (contract.phase.period, contract.phase.offsets.tolist()) == (1.0, [0.0, np.pi])
    older = read(tmp_path, {**HOLOSOMA, "action_scale": "[0.5, 0.25]"})
    assert older.missing == ("default_joint_pos", "observation")
    assert older.values["action_scale"].tolist() == [0.5, 0.25]


DEPLOY = yaml.safe_load("""
joint_ids_map: [2, 0, 3, 1]
step_dt: 0.02
stiffness: [10.0, 11.0, 12.0, 13.0]
damping: [1.0, 1.1, 1.2, 1.3]
default_joint_pos: [0.2, 0.0, 0.3, 0.1]
commands: {base_velocity: {ranges: {lin_vel_x: [-1, 1], lin_vel_y: [0, 0], ang_vel_z: [-2, 2], heading: null}}}
actions: {JointPositionAction: {clip: null, joint_names: [.*], scale: [0.25, 0.25, 0.25, 0.25], offset: [0, 0, 0, 0]}}
observations:
  base_ang_vel: {params: {}, clip: null, scale: [0.2, 0.2, 0.2], history_length: 5}
  joint_pos_rel: {params: {}, clip: [-10, 10], scale: null, history_length: 0}
  gait_phase: {params: {period: 0.6}, clip: null, scale: [1.0, 1.0]}
""")


def deploy(**changes):
    return yaml.safe_dump({**DEPLOY, **changes}, sort_keys=False)


def deployed(folder, **changes):
    for name in ("params", "exported"):
        (folder / name).mkdir()
    (folder / "params" / "deploy.yaml").write_text(deploy(**changes))
    return read(folder / "exported")


def test_unitrees_deploy_yaml(tmp_path):
    reading = deployed(tmp_path)
    contract = reading.contract
    assert contract.joint_names == ("c", "a", "d", "b")
    assert contract.joint_stiffness.tolist() == [12.0, 10.0, 13.0, 11.0]  # listed in the robot's order
    assert contract.default_joint_pos.tolist() == [0.2, 0.0, 0.3, 0.1]  # and this in the policy's
    assert contract.command_ranges.tolist() == [[-1, 1], [0, 0], [-2, 2]]
    gyro, joints, _ = contract.terms
    assert (gyro.history, gyro.scale.tolist(), joints.clip, joints.history) == (5, [0.2] * 3, (-10, 10), 1)
    assert (contract.phase.period, contract.phase.standing_value) == (0.6, None)
    assert reading.source["joint_names"] == "deploy.yaml and the robot"
    assert reading.source["phase.standing_value"] == "assumed (Unitree)"


def test_gains_of_a_robot_that_lacks_some_joints_of_the_full_one(tmp_path):
    gaps = deployed(tmp_path, joint_ids_map=[0, 1, 5, 3])
    assert gaps.contract.joint_names == ("a", "b", "d", "c")
    assert gaps.contract.joint_stiffness.tolist() == [10.0, 11.0, 13.0, 12.0]
    assert "[2, 4]" in gaps.unused[0]


def test_a_slice_of_pythons_is_read_without_calling_python(tmp_path):
    deployed(tmp_path, observations=None)
    path = tmp_path / "params" / "deploy.yaml"
    joints = "{asset_cfg: {joint_ids: !!python/object/apply:builtins.slice [0, 2, null]}}"
    term = f"observations:\n  joint_vel_rel: {{scale: 0.05, params: {joints}}}\n"
    path.write_text(path.read_text().replace("observations: null\n", term))
    assert read(tmp_path / "exported").contract.terms[0].joints == ("c", "a")


ENV = """\
decimation: 4
sim: {dt: 0.005}
scene:
  robot:
    init_state:
      joint_pos: {c: 0.3, "[ab]": -0.1}
    actuators:
      legs: {joint_names_expr: ["[ab]"], stiffness: {".*": 40.0, b: 50.0}, damping: 2.0, effort_limit_sim: 80.0}
      rest: {joint_names_expr: ["[cd]"], stiffness: 20.0, damping: 1.0, effort_limit: 30.0}
actions:
  joint_pos: {class_type: "isaaclab.envs.mdp.actions:JointPositionAction", scale: 0.25, use_default_offset: true}
observations:
  policy:
    concatenate_terms: true
    history_length: null
    gyro: {func: "isaaclab.envs.mdp.observations:base_ang_vel", scale: 0.2, clip: !!python/tuple [-5.0, 5.0]}
    velocity:
      func: "isaaclab.envs.mdp.observations:generated_commands"
      params: {command_name: base_velocity}
      noise: !!python/object:somewhere.Noise {std: !!python/name:somewhere.deviation ''}
    joint_pos: {func: "isaaclab.envs.mdp.observations:joint_pos", history_length: 3}
    last_action: {func: "isaaclab.envs.mdp.observations:last_action"}
"""


def test_isaac_labs_env_yaml(tmp_path):
    (tmp_path / "params").mkdir()
    (tmp_path / "params" / "env.yaml").write_text(ENV)
    assert read(tmp_path).missing == ("joint_names",)
    assert "order of the joints" in read(tmp_path).problems["contract"]
    (tmp_path / "contract.yaml").write_text("joint_names: [a, c, b, d]\n")
    contract = read(tmp_path).contract
    assert contract.joint_stiffness.tolist() == [40.0, 20.0, 50.0, 20.0]
    assert contract.effort_limit.tolist() == [80.0, 30.0, 80.0, 30.0]
    assert contract.default_joint_pos.tolist() == [-0.1, 0.3, -0.1, 0.0]
    assert (contract.policy_dt, contract.action_scale.tolist()) == (0.02, [0.25] * 4)
    assert [contract.kind(term).name for term in contract.terms] == [
        *("base_ang_vel", "velocity_command", "joint_pos", "actions")
    ]
    gyro, _, positions, _ = contract.terms
    assert (gyro.clip, positions.relative, positions.history) == ((-5.0, 5.0), False, 3)
    (tmp_path / "params" / "env.yaml").write_text("scene: [\n")  # what only the training needs stops nothing
    assert "env.yaml cannot be read" in read(tmp_path).unused[0]


BERKELEY = """
joints: [a, b, c, d]
policy_checkpoint_path: checkpoints/policy.onnx
joint_kp: [20.0, 30.0, 40.0, 50.0]
joint_kd: 2.0
default_joint_positions: [0.0, 0.1, 0.2, 0.3]
effort_limits: 6.0
num_observations: 21
history_length: 1
action_indices: [1, 3]
action_scale: 0.25
action_limit_lower: -100.0
action_limit_upper: 100.0
policy_dt: 0.04
"""


def test_berkeleys_yaml(tmp_path):
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "policy.yaml").write_text(BERKELEY)
    contract = read(tmp_path).contract
    assert (contract.joint_names, contract.action_joint_names) == (ROBOT, ("b", "d"))
    assert contract.terms[3].joints == ("b", "d")
    assert (contract.terms[0].history, contract.history_layout) == (2, "per_step")
    assert (contract.action_clip, contract.action_limit, contract.policy_dt) == (100.0, 1e4, 0.04)


def action(**options):
    return deploy(actions={"JointPositionAction": {"scale": 1.0, **options}})


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("policy.yaml", BERKELEY.replace("-100.0", "-1.0"), "not -x and x"),
        ("deploy.yaml", "", "is empty"),
        ("deploy.yaml", deploy(joint_ids_map=[0, 1, 9], stiffness=1.0, damping=1.0), "map is for another robot"),
        ("deploy.yaml", deploy(joint_ids_map=[0, -1]), "joint_ids_map: "),
        ("deploy.yaml", deploy(step_dt="50 Hz"), "is 50 Hz"),
        ("deploy.yaml", action(joint_names=["["]), "has no pattern"),
        ("deploy.yaml", action(joint_names=["knee"]), "unknown joint 'knee'"),
        ("deploy.yaml", deploy(actions={"JointVelocityAction": {}}), "expected JointPositionAction alone"),
        ("deploy.yaml", deploy(stiffness=[1.0, 2.0]), "stiffness has 2 values, expected 4"),
        ("deploy.yaml", deploy(observations={"policy": {"a": {}}, "critic": {"b": {}}}), "groups policy, critic"),
    ],
)
def test_a_trainers_file_that_is_wrong(tmp_path, file, text, message):
    (tmp_path / file).write_text(text)
    with pytest.raises(InputError, match=rf"{file}.*{message}"):
        read(tmp_path)


@pytest.mark.parametrize("name", ["deploy.yaml", "env.yaml", "policy.yaml"])
def test_a_file_of_another_program_is_named(tmp_path, name):
    (tmp_path / name).write_text("services: {web: {image: nginx}}")
    assert read(tmp_path).unused == (f"{name}, which is of no kind that is known",)


@pytest.mark.parametrize(
    ("old", "new", "missing", "unused"),
    [
        ("joint_kd: 2.0", "joint_kds: 2.0", ("joint_damping",), "policy.yaml: joint_kds: not read"),
        ("action_indices: [1, 3]", "", (), ""),
        (BERKELEY, "[some, other]", None, "policy.yaml, which is of no kind that is known"),
    ],
)
def test_what_berkeleys_yaml_lacks_or_has_beside_is_told(tmp_path, old, new, missing, unused):
    (tmp_path / "policy.yaml").write_text(BERKELEY.replace(old, new))
    reading = read(tmp_path)
    assert "\n".join(reading.unused) == unused
    assert missing is None or reading.missing == missing


MJLAB_ENV = """\
scene:
  entities:
    robot:
      init_state: {joint_pos: {knee: 0.3}}
      articulation:
        actuators: !!python/tuple
        - {target_names_expr: !!python/tuple [hip], stiffness: 40.0, damping: 1.0, effort_limit: 88.0, delay_max_lag: 2}
        - {target_names_expr: [knee], stiffness: 99.0, damping: 2.0, effort_limit: 139.0, delay_max_lag: 0}
observations:
  actor: {terms: {command: {}, joint_pos: {scale: 0.5, history_length: 3}, actions: {}}, concatenate_terms: true}
commands:
  motion: {anchor_body_name: torso, body_names: !!python/tuple [pelvis, torso]}
  base_velocity:
    ranges: {lin_vel_x: [0.0, 0.1], lin_vel_y: [0, 0], ang_vel_z: [0, 0]}
    limit_ranges: {lin_vel_x: [-0.5, 1.0], lin_vel_y: [0, 0], ang_vel_z: [-1, 1]}
"""


def test_mjlabs_env_yaml_has_robot_and_terms_one_deeper_and_commands_have_their_motions_anchor(tmp_path):
    (tmp_path / "env.yaml").write_text(MJLAB_ENV)
    (tmp_path / "contract.yaml").write_text("joint_names: [knee, hip]\n")
    reading = read(tmp_path)
    values = {name: getattr(value, "tolist", lambda value=value: value)() for name, value in reading.values.items()}
    assert values["observation"] == ("command", "joint_pos", "actions")
    assert (values["observation.joint_pos.history"], values["default_joint_pos"]) == (3, [0.3, 0.0])
    assert (values["joint_stiffness"], values["effort_limit"]) == ([99.0, 40.0], [139.0, 88.0])
    assert (values["anchor_body"], values["body_names"]) == ("torso", ("pelvis", "torso"))
    assert values["command_ranges"][0] == [-0.5, 1.0]
    assert reading.unused == ("env.yaml: actuators 0 are delayed, which is not read",)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("observations:base_ang_vel", "observations:root_quat_w", "gyro is computed by isaaclab.envs.mdp"),
        ("scale: 0.2,", "scale: 0.2, modifiers: [{bias: 1}],", "gyro has modifiers"),
        ("legs: {", 'legs: {class_type: "isaaclab.actuators:ActuatorNetLSTM", ', "legs are ActuatorNetLSTM, a network"),
        ("legs: {", 'legs: {class_type: "isaaclab.actuators:DelayedPDActuator", ', "are delayed, which is not read"),
        ("concatenate_terms: true", "concatenate_terms: false", "concatenate_terms is false"),
        ("  policy:", "  proprio:", "observations of proprio are not read, expected policy"),
    ],
)
def test_what_an_env_yaml_does_beyond_a_contract_is_named(tmp_path, old, new, line):
    (tmp_path / "env.yaml").write_text(ENV.replace(old, new))
    assert any(line in unused for unused in read(tmp_path).unused)


def test_other_actions_are_refused_whatever_else_is_known(tmp_path):
    (tmp_path / "env.yaml").write_text(ENV.replace("JointPositionAction", "JointEffortAction"))
    with pytest.raises(InputError, match="is a JointEffortAction, expected a JointPositionAction"):
        read(tmp_path, MJLAB)


@pytest.mark.parametrize(
    ("chosen", "joints"),
    [
        ("joint_names: [d, b, a]", ("a", "b", "d")),
        ("actuator_names: [d, '[ab]']", ("a", "b", "d")),
        ("joint_names: [d, b, a], preserve_order: true", ("d", "b", "a")),
        ("joint_names: [.*]", ("a", "c", "b", "d")),
    ],
)
def test_the_joints_of_an_action_in_an_env_yaml_are_in_the_robots_order(tmp_path, chosen, joints):
    (tmp_path / "env.yaml").write_text(ENV.replace("scale: 0.25", f"scale: 0.25, {chosen}"))
    (tmp_path / "contract.yaml").write_text("joint_names: [a, c, b, d]\n")
    assert read(tmp_path).contract.action_joint_names == joints


def test_the_joints_of_a_term_in_an_env_yaml_are_in_the_robots_order(tmp_path):
    chosen = "history_length: 3, params: {asset_cfg: {joint_ids: null, joint_names: [d, '[ab]']}}"
    (tmp_path / "env.yaml").write_text(ENV.replace("history_length: 3", chosen))
    (tmp_path / "contract.yaml").write_text("joint_names: [a, c, b, d]\n")
    assert read(tmp_path).contract.terms[2].joints == ("a", "b", "d")


@pytest.mark.parametrize(("text", "clip"), [("clip_actions: 5.0", 5.0), ("params: {env: {clip_actions: 1}}", 1.0)])
def test_actions_are_clipped_as_the_learner_did(tmp_path, text, clip):
    (tmp_path / "agent.yaml").write_text(text)
    assert read(tmp_path, MJLAB).contract.action_clip == clip
