"""Published policies, right and with mistakes planted: `examine_plants.py [--trace] POLICY ...`."""

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console

sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[1] / "policy")]
import plants
from plants import Plant, alike, swapped, term, turned
from published import G1, HOLOSOMA_REST, POLICIES, TRACES

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor.edits import isaac_order
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import Result, search_episodes, search_trace
from humanoid_sim.doctor.trial import Subject, load_subject
from humanoid_sim.robots.description import load_robot

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


def playground_contract() -> dict[str, Any]:
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


def published(policy: str, folder: Path) -> Subject:
    """One of the policies; `folder` takes the contract.yaml that some need."""
    rest = {"holosoma": lambda: HOLOSOMA_REST, "playground": lambda: yaml.safe_dump(playground_contract())}
    file = folder / f"{policy}.yaml" if policy in rest else None
    if file is not None:
        file.write_text(rest[policy]())
    model, _, robot = FILES[policy]
    return load_subject(POLICIES / model, load_robot(str(POLICIES / robot)), file)


def trace_of(policy: str) -> Path:
    return POLICIES / FILES[policy][1]


def plants_of(policy: str, right: Subject) -> dict[str, Plant]:
    """The mistakes that a policy can have, by name."""
    robot, breadth_first = right.description.joint_names, isaac_order(right.description)
    pick: dict[str, tuple[Any, ...]] = {
        "unitree": (("left_hip_roll_joint", "left_hip_yaw_joint"), breadth_first, "left_knee_joint", "base_ang_vel",
                    ("joint_pos_rel", "joint_vel_rel"), "last_action", "projected_gravity", breadth_first),
        "waltz": (("left_knee_joint", "left_shoulder_pitch_joint"), robot, "right_hip_roll_joint", "base_ang_vel",
                  ("base_lin_vel", "base_ang_vel"), "actions", "", robot),
        "holosoma": (("left_hip_pitch_joint", "right_hip_pitch_joint"), breadth_first, "right_knee_joint",
                     "base_ang_vel", ("dof_pos", "dof_vel"), "actions", "projected_gravity", breadth_first),
        "berkeley": (("leg_left_hip_yaw_joint", "leg_left_hip_pitch_joint"), breadth_first,
                     "leg_right_knee_pitch_joint", "base_ang_vel", ("base_ang_vel", "projected_gravity"), "last_action",
                     "projected_gravity", ()),
        "playground": (("LL_HFE", "LL_KFE"), tuple(sorted(robot)), "LR_HAA", "base_ang_vel",
                       ("joint_pos", "joint_vel"), "actions", "projected_gravity", breadth_first),
    }  # fmt: skip
    pair, order, joint, gyro, terms, action, gravity, gains = pick[policy]
    found: dict[str, Plant] = {
        "two joints swapped": swapped(*pair),
        "order of all joints": plants.relabelled(order),
        "sign of a joint": turned(joint),
        "gains x 2": plants.multiplied(2.0, "joint_stiffness", "joint_damping"),
        "action scale x 0.5": plants.multiplied(0.5, "action_scale"),
        "default pose zero": plants.no_pose,
        "gyro in the world frame": term(gyro, frame="world"),
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


def search(right: Subject, wrong: PolicyContract, trace: Path | None = None) -> Result:
    """What the doctor finds in a wrong contract, on a trace or in simulation."""
    subject = replace(right, contract=wrong, motion=right.motion_under(wrong))
    return (
        search_episodes(subject, Console(quiet=True))
        if trace is None
        else search_trace(subject, Samples(subject, trace))
    )


def examine(policy: str, *, with_trace: bool) -> None:
    """Print a row for each plant, and how many were named first."""
    right = published(policy, Path(tempfile.mkdtemp()))
    wrong, named, seconds = plants_of(policy, right), 0, []
    for name, plant in {"the right contract": lambda contract: contract, **wrong}.items():
        start = time.perf_counter()
        result = search(right, plant(right.contract), trace_of(policy) if with_trace else None)
        seconds.append(time.perf_counter() - start)
        found = result.finding
        is_right = found is None if name not in wrong else found is not None and alike(found.contract, right.contract)
        is_right |= name == "default pose zero" and found is not None and found.family == "default pose"
        named += is_right and name in wrong
        print(f"{policy} | {name} | {'yes' if is_right else 'NO'} | {result.verdict} | {seconds[-1]:.0f} s", flush=True)
    median = sorted(seconds)[len(seconds) // 2]
    print(f"{policy} | {named} of {len(wrong)} | median {median:.0f} s, largest {max(seconds):.0f} s", flush=True)


if __name__ == "__main__":
    for word in sys.argv[1:]:
        if not word.startswith("--"):
            examine(word, with_trace="--trace" in sys.argv)
