"""The published policies as subjects of the doctor, under their right contracts, and their traces."""

import json
from pathlib import Path
from typing import Any

import yaml
from published import G1, HOLOSOMA_REST, POLICIES, TRACES

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
