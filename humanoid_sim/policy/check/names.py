"""Whether the robot has the joints and bodies that the policy names, and which ones it may have meant."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Sequence

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.check.finding import Finding
from humanoid_sim.robots.description import RobotDescription

__all__ = ["body_findings", "joint_findings", "near_miss"]

_AFFIXES = re.compile(r"^(joint_)|(_joint|_link|_dof|_motor)$")
_SIDES = ((r"^l_", "left_"), (r"^r_", "right_"), (r"_l$", "_left"), (r"_r$", "_right"))


def joint_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints that only the policy or only the robot has."""
    robot, policy = description.joint_names, contract.joint_names
    surplus = [name for name in robot if name not in policy]
    for name in policy:
        if name not in robot:
            meant = near_miss(name, surplus)
            hint = f", which has '{meant}': rename it in a contract.yaml" if meant else ""
            yield Finding("error", "joint_names", f"is not a joint of '{description.name}'{hint}", joint=name)
    meant_ones = {near_miss(name, surplus) for name in policy if name not in robot}
    for name in surplus:
        if name not in meant_ones:
            message = f"'{description.name}' has it, the policy does not; its joints have to be the robot's"
            yield Finding("error", "joint_names", message, joint=name)


def body_findings(contract: PolicyContract, bodies: Sequence[str], robot: str) -> Iterator[Finding]:
    """Bodies of the motion that the robot's model lacks.

    Args:
        contract: of the policy.
        bodies: names of all bodies of the model.
        robot: its name.
    """
    named = [("body_names", name) for name in contract.body_names]
    if contract.anchor_body:
        named.append(("anchor_body", contract.anchor_body))
    for field, name in named:
        if name not in bodies:
            meant = near_miss(name, bodies)
            hint = f", which has '{meant}'" if meant else f"; it has: {', '.join(bodies)}"
            yield Finding("error", field, f"'{name}' is not a body of '{robot}'{hint}")
    if contract.anchor_body and contract.body_names and contract.anchor_body not in contract.body_names:
        message = f"'{contract.anchor_body}' is not among body_names: {', '.join(contract.body_names)}"
        yield Finding("warning", "anchor_body", f"{message}; a motion of those bodies does not tell where it is")


def near_miss(name: str, known: Sequence[str]) -> str:
    """The one of the known names that was probably meant; empty if none is close."""
    plain = {_plain(other): other for other in known}
    if _plain(name) in plain:
        return plain[_plain(name)]
    close = difflib.get_close_matches(_plain(name), list(plain), n=1, cutoff=0.85)
    # left_knee and right_knee are close in letters and far in meaning.
    if close and _side(close[0]) == _side(_plain(name)):
        return plain[close[0]]
    return ""


def _plain(name: str) -> str:
    """A name without what exporters add, drop or spell differently."""
    text = name.rpartition("/")[2].lower().replace("-", "_").replace(" ", "_")
    text = _AFFIXES.sub("", text)
    for pattern, side in _SIDES:
        text = re.sub(pattern, side, text)
    return text


def _side(name: str) -> str:
    return "left" if "left" in name else "right" if "right" in name else ""
