"""What tests of `policy check` share: a policy for the Lite, and looking for one finding among others."""

from typing import Any

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.policy.checks import Finding
from humanoid_sim.robots.description import RobotDescription


def lite_contract(lite: RobotDescription, **changes: Any) -> PolicyContract:
    """A plausible policy for the Lite."""
    wiring = placeholder_checkpoint(lite).contract
    values: dict[str, Any] = {
        name: getattr(wiring, name) for name in ("task_type", "joint_names", "action_joint_names")
    }
    values |= {"joint_stiffness": wiring.joint_stiffness, "joint_damping": wiring.joint_damping, "body_names": ()}
    values |= {"default_joint_pos": wiring.default_joint_pos, "observation": ("joint_pos",), "command_names": ()}
    return PolicyContract(**{**values, "action_scale": 0.1, "policy_dt": 0.02, **changes})


def found(findings: Any, severity: str, field: str, joint: str = "") -> Finding:
    """The one finding of that kind."""
    findings = tuple(findings)
    hits = [f for f in findings if (f.severity, f.field, f.joint) == (severity, field, joint)]
    assert len(hits) == 1, "\n".join(f"{f.severity} {f}" for f in findings)
    return hits[0]


def errors(findings: Any) -> list[str]:
    return [str(finding) for finding in findings if finding.severity == "error"]
