"""The policies as the doctor sees them, under their right contracts: published ones, and those that ship."""

import json
from pathlib import Path
from typing import Any

import yaml
from published import G1, HOLOSOMA_REST, POLICIES, TRACES

from humanoid_sim.assets import policy_path
from humanoid_sim.doctor.examined_policy import ExaminedPolicy
from humanoid_sim.doctor.examined_policy import load_examined as load
from humanoid_sim.robots.description import load_robot

CHECKPOINTS = {
    **{name: TRACES[name][0] for name in ("unitree", "waltz", "holosoma")},
    "berkeley": "berkeley_humanoid_lite_biped_50hz/checkpoints/policy_biped_50hz.onnx",
    "playground": "playground_berkeley_humanoid/bh_policy.onnx",
}
SHIPPED = {"legs": ("lite_biped_velocity", "lite_biped", None), "arms": ("lite_tracking", "lite", "wave")}
"""Policy, robot, motion."""
ROBOTS = {
    "berkeley": "models/berkeley_humanoid_lite_biped/scene.xml",
    "playground": "models/playground_berkeley_humanoid/scene_native.xml",
}


def playground_contract() -> dict[str, Any]:
    """What facts.json says, for the checkpoint says nothing."""
    facts = json.loads((POLICIES / "playground_berkeley_humanoid" / "facts.json").read_text())
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
            "base_ang_vel",
            "projected_gravity",
            "velocity_commands",
            "joint_pos",
            "joint_vel",
            "actions",
            "cos_phase",
            "sin_phase",
        ],
    }


def contract_file(policy: str, folder: Path) -> Path | None:
    """The contract.yaml that a policy needs, in the folder; None where it needs none."""
    rest = {"holosoma": lambda: HOLOSOMA_REST, "playground": lambda: yaml.safe_dump(playground_contract())}
    if policy not in rest:
        return None
    file = folder / "contract.yaml"
    file.write_text(rest[policy]())
    return file


def load_examined(policy: str, folder: Path) -> ExaminedPolicy:
    """One of the policies; `folder` takes the contract.yaml that some need."""
    if policy in SHIPPED:
        name, robot, motion = SHIPPED[policy]
        return load(policy_path(Path(name)), load_robot(robot), None, motion)
    robot = load_robot(POLICIES / ROBOTS.get(policy, G1))
    return load(POLICIES / CHECKPOINTS[policy], robot, contract_file(policy, folder))
