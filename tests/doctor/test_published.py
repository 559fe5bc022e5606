"""Published policies: right contracts are clean, planted mistakes are named, with a trace and in simulation."""

import json
from dataclasses import replace

import plants
import pytest
import yaml
from plants import alike, swapped, term, turned
from published import G1, HOLOSOMA_REST, POLICIES, TRACES, needs_policies
from rich.console import Console

from humanoid_sim.doctor.edits import isaac_order
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import search_episodes, search_trace
from humanoid_sim.doctor.trial import load_subject
from humanoid_sim.robots.description import load_robot

pytestmark = needs_policies
_BERKELEY, _PLAYGROUND = "berkeley_humanoid_lite_biped_50hz", "playground_berkeley_humanoid"
FILES = {
    **{name: (*files, G1) for name, files in TRACES.items()},
    "berkeley": (
        f"{_BERKELEY}/checkpoints/policy_biped_50hz.onnx",
        f"{_BERKELEY}/trace.npz",
        "models/berkeley_humanoid_lite_biped/scene.xml",
    ),
    "playground": (
        f"{_PLAYGROUND}/bh_policy.onnx",
        f"{_PLAYGROUND}/trace.npz",
        "models/playground_berkeley_humanoid/scene_native.xml",
    ),
}
"""Model, trace and robot."""


def playground_contract():
    """What facts.json says, for the checkpoint says nothing."""
    facts = json.loads((POLICIES / _PLAYGROUND / "facts.json").read_text())
    return {
        "joint_names": facts["joint_order"],
        "joint_stiffness": facts["kp"],
        "joint_damping": facts["kd"],
        "default_joint_pos": facts["default_joint_pos"],
        "action_scale": facts["action_scale"],
        "policy_dt": facts["control_dt"],
        "model_joint_damping": "drop",  # it is in the gains
        "position_clip": "joint_limits",
        "phase": {"period": 1.0 / 1.5, "offsets": [0.0, 3.141592653589793], "advance_first": False},
        "observation": [
            {"name": "base_lin_vel", "at": "imu"},
            *("base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos", "joint_vel", "actions"),
            *("cos_phase", "sin_phase"),
        ],
    }


def published(policy, folder):
    """One of the policies; `folder` takes the contract.yaml that some need."""
    rest = {"holosoma": lambda: HOLOSOMA_REST, "playground": lambda: yaml.safe_dump(playground_contract())}
    file = folder / f"{policy}.yaml" if policy in rest else None
    if file is not None:
        file.write_text(rest[policy]())
    model, _, robot = FILES[policy]
    return load_subject(POLICIES / model, load_robot(str(POLICIES / robot)), file)


def plants_of(policy, right):
    """The mistakes that a policy can have, by name."""
    robot, breadth_first = right.description.joint_names, isaac_order(right.description)
    pick = {
        "unitree": (("left_hip_roll_joint", "left_hip_yaw_joint"), breadth_first, "left_knee_joint",
                    ("joint_pos_rel", "joint_vel_rel"), "last_action", "projected_gravity", breadth_first),
        "waltz": (("left_knee_joint", "left_shoulder_pitch_joint"), robot, "right_hip_roll_joint",
                  ("base_lin_vel", "base_ang_vel"), "actions", "", robot),
        "holosoma": (("left_hip_pitch_joint", "right_hip_pitch_joint"), breadth_first, "right_knee_joint",
                     ("dof_pos", "dof_vel"), "actions", "projected_gravity", breadth_first),
        "berkeley": (("leg_left_hip_yaw_joint", "leg_left_hip_pitch_joint"), breadth_first,
                     "leg_right_knee_pitch_joint", ("base_ang_vel", "projected_gravity"), "last_action",
                     "projected_gravity", ()),
        "playground": (("LL_HFE", "LL_KFE"), tuple(sorted(robot)), "LR_HAA",
                       ("joint_pos", "joint_vel"), "actions", "projected_gravity", breadth_first),
    }  # fmt: skip
    pair, order, joint, terms, action, gravity, gains = pick[policy]
    found = {
        "two joints swapped": swapped(*pair),
        "order of all joints": plants.relabelled(order),
        "sign of a joint": turned(joint),
        "gains x 2": plants.multiplied(2.0, "joint_stiffness", "joint_damping"),
        "action scale x 0.5": plants.multiplied(0.5, "action_scale"),
        "default pose zero": plants.no_pose,
        "gyro in the world frame": term("base_ang_vel", frame="world"),
        "25 Hz": plants.at_rate(25.0),
        "two terms swapped": plants.terms_swapped(*terms),
        "last action scaled": term(action, form="scaled"),
    }
    if gravity:
        found["gravity sign"] = term(gravity, scale=-1.0)
    if policy == "waltz":
        found["quaternion order"] = lambda contract: replace(contract, reference_quaternion="xyzw")
    if gains:
        found["gains in another order"] = plants.gains_listed(gains)
    return found


def search(policy, folder, plant, *, with_trace):
    """What the doctor finds in a contract with a mistake, '' for none, and whether that is right."""
    right = published(policy, folder)
    subject = right.under(plants_of(policy, right)[plant](right.contract)) if plant else right
    if with_trace:
        result = search_trace(subject, Samples(subject, POLICIES / FILES[policy][1]))
    else:
        result = search_episodes(subject, Console(quiet=True))
    found = result.finding
    if not plant or found is None:
        return result, not plant and found is None
    is_pose = not with_trace and plant == "default pose zero" and found.family == "default pose"  # any bent knees
    return result, is_pose or alike(found.contract, right.contract)


QUICK = [
    ("berkeley", ""),
    ("playground", ""),
    ("berkeley", "sign of a joint"),
    ("berkeley", "default pose zero"),
    ("playground", "gains in another order"),
    ("holosoma", "25 Hz"),
    ("waltz", "quaternion order"),
]


@pytest.mark.parametrize(("policy", "plant"), QUICK)
def test_a_planted_mistake_is_named_first_and_a_right_contract_is_clean(tmp_path, policy, plant):
    result, is_right = search(policy, tmp_path, plant, with_trace=True)
    assert is_right
    assert result.is_healthy is not bool(plant)


WITHOUT_TRACE = {"unitree": 10, "waltz": 10, "holosoma": 11, "berkeley": 9, "playground": 9}


@pytest.mark.soak
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("policy", WITHOUT_TRACE)
@pytest.mark.parametrize("with_trace", [True, False])
def test_how_many_mistakes_are_named_first(tmp_path, policy, with_trace):
    wrong = plants_of(policy, published(policy, tmp_path))
    missed = [plant for plant in ("", *wrong) if not search(policy, tmp_path, plant, with_trace=with_trace)[1]]
    assert "" not in missed
    assert len(wrong) - len(missed) >= (len(wrong) if with_trace else WITHOUT_TRACE[policy]), missed
