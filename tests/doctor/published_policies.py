"""The published policies as the doctor sees them, under their right contracts."""

from __future__ import annotations

from pathlib import Path

from published import HOLOSOMA_REST, POLICIES

from humanoid_sim.doctor.examined_policy import ExaminedPolicy
from humanoid_sim.doctor.examined_policy import load_examined as load
from humanoid_sim.robots.description import load_robot

CHECKPOINTS = {
    "unitree": "unitree_g1_velocity_v0/exported/policy.onnx",
    "waltz": "beyondmimic_g1/Waltz.onnx",
    "holosoma": "holosoma_g1_loco/ppo_g1_29dof.onnx",
}
ROBOT = POLICIES / "models" / "unitree_g1" / "scene.xml"


def load_examined(policy: str, folder: Path) -> ExaminedPolicy:
    """One of the policies; `folder` takes the contract.yaml that holosoma's needs."""
    contract_file = None
    if policy == "holosoma":
        contract_file = folder / "contract.yaml"
        contract_file.write_text(HOLOSOMA_REST)
    return load(POLICIES / CHECKPOINTS[policy], load_robot(ROBOT), contract_file)
