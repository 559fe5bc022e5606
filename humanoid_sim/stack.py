"""Put the control stack together for a robot and a policy, and again for a recording of them."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from importlib.metadata import version
from typing import NoReturn, TypeAlias

from msgspec.structs import asdict

from humanoid_sim.controllers.base import (
    DAMPING,
    REMOTE_POLICY,
    RL_POLICY,
    STANDBY_A,
    STANDBY_B,
    ZERO_TORQUE,
    Controller,
)
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.damping import DampingController, ZeroTorqueController
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.standby import StandbyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.errors import blaming
from humanoid_sim.messages import URDF_DOCUMENT, SessionHeader
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import MOTION_ATTACHMENT, Motion, motion_bytes, parse_motion
from humanoid_sim.policy.readers.own import decode, encode
from humanoid_sim.recording.header import LABELS_DOCUMENT
from humanoid_sim.robots.description import RobotDescription, with_joint_limits
from humanoid_sim.robots.guards import guards_of
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.robots.urdf import urdf_of

Policies: TypeAlias = LoadedPolicy | Mapping[str, LoadedPolicy] | None
"""The policy of a stack, or several by name, of which the first is selected at the start."""


def _by_name(policies: Policies) -> Mapping[str, LoadedPolicy]:
    """Return policies by name; a single one has none."""
    if isinstance(policies, LoadedPolicy):
        return {"": policies}
    return policies or {}


def build_supervisor(
    description: RobotDescription,
    control_period: float,
    policies: Policies,
    *,
    remote: bool = False,
    live: Mapping[str, int] | None = None,
) -> Supervisor:
    """Return the supervisor of a robot with the controllers that are available.

    Raises `InputError` if a policy does not fit the robot.

    Args:
        description: the robot; it holds the parameters of all controllers but the policy's.
        live: names and widths of the live inputs that this robot and its operator provide; a policy that needs another
            (an estimate of the base's velocity, on a robot without one) is refused. None: every one that is known.
    """
    joints, settings = description.joint_names, description.remote_policy_controller
    controllers: dict[str, Controller] = {
        ZERO_TORQUE: ZeroTorqueController(joints),
        DAMPING: DampingController(joints, description.mode_damping),
        STANDBY_A: StandbyController(joints, **asdict(description.standby_controller_a)),
        STANDBY_B: StandbyController(joints, **asdict(description.standby_controller_b)),
    }
    learned = {
        name: policy_controller(description, control_period, policy, live=live)
        for name, policy in _by_name(policies).items()
    }
    if "" in learned:
        controllers[RL_POLICY] = learned.pop("")
    if remote:
        controllers[REMOTE_POLICY] = RemotePolicyController(
            joints,
            description.passive_damping,
            settings.stale_command_policy,
            settings.stale_command_timeout_ms,
            needs_producer=description.is_floating,
        )
    return Supervisor(joints, controllers, guards=guards_of(description), policies=learned)


def policy_controller(
    description: RobotDescription,
    control_period: float,
    loaded: LoadedPolicy,
    *,
    live: Mapping[str, int] | None = None,
) -> RLPolicyController:
    """Return the controller of a policy on a robot; arguments and errors as of `build_supervisor`."""
    with blaming(f"policy on robot '{description.name}'"):
        return RLPolicyController(
            description.joint_names,
            with_joint_limits(loaded.contract, description),
            loaded.reference,
            loaded.policy,
            control_period,
            extern=loaded.extern if live is None else live,
        )


def run_header(
    description: RobotDescription,
    control_period: float,
    policies: Policies,
    *,
    settings: Mapping[str, object],
    start_time_ns: int = 0,
    remote: bool = False,
) -> SessionHeader:
    """Return what a recording says of its run: `rebuild_supervisor` makes the same supervisor again.

    Arguments are as of `build_supervisor`; `settings` is anything else that a reader may want to know, as JSON;
    `start_time_ns` is Unix time at the robot clock's zero.
    """
    versions = {"python": platform.python_version(), **{name: version(name) for name in ("mujoco", "numpy")}}
    shown = {**settings, "versions": versions, "platform": platform.platform()}
    documents = {
        URDF_DOCUMENT: urdf_of(bare_model(description), description),
        "robot": description.to_json(),
        "settings": json.dumps(shown, indent=1),
        "controllers": json.dumps({"remote": remote}),
    }
    named = _by_name(policies)
    described: dict[str, dict[str, str | None]] = {}
    attachments: dict[str, bytes] = {}
    widths: tuple[tuple[str, int], ...] = ()
    for name, policy in named.items():
        file = f"{name}.{MOTION_ATTACHMENT}" if described else MOTION_ATTACHMENT
        if policy.motion is not None:
            attachments[file] = motion_bytes(policy.motion)
        contract = encode(policy.contract)
        if not described:
            widths = tuple((term.name, term.width) for term in policy.layout.terms)
            labels = {"observation": policy.observation_labels, "action": policy.contract.action_joint_names}
            documents["contract"] = contract
            documents[LABELS_DOCUMENT] = json.dumps(labels)
        described[name] = {"contract": contract, "motion": file if file in attachments else None}
    if named and "" not in named:
        documents["policies"] = json.dumps(described)
    return SessionHeader(
        robot=description.name,
        joint_names=description.joint_names,
        control_period=control_period,
        start_time_ns=start_time_ns,
        documents=documents,
        attachments=attachments,
        observation_terms=widths,
    )


def recorded_contracts(header: SessionHeader) -> tuple[PolicyContract, ...]:
    """Return the contracts of all of a run's policies, the first one first. Raises `InputError` if they are damaged."""
    several = json.loads(header.documents.get("policies", "{}")).values()
    texts = [one["contract"] for one in several] or [header.documents.get("contract")]
    return tuple(decode(text, "recording") for text in texts if text is not None)


def recorded_motion(header: SessionHeader, name: str | None = MOTION_ATTACHMENT) -> Motion | None:
    """Return the motion that a recorded run's policy follows; None if it follows none."""
    attached = None if name is None else header.attachments.get(name)
    return None if attached is None else parse_motion(attached, name or "")


def no_policy(*_: object) -> NoReturn:
    """Stand in for a policy that is not to run."""
    raise AssertionError("this policy is not to run")


def recorded_policy(header: SessionHeader, policy: Policy) -> LoadedPolicy | None:
    """Return a recorded run's first contract and motion, with `policy` in the place of its own; None if it had none."""
    contract = next(iter(recorded_contracts(header)), None)
    return None if contract is None else load_policy(contract, policy, recorded_motion(header))


def rebuild_supervisor(header: SessionHeader, policy: Policy) -> Supervisor:
    """Return the supervisor of a recorded run with `policy` in the place of the one that ran.

    Raises `InputError` if the header lacks what is needed.
    """
    with blaming("recording: its header is damaged, or lacks", (KeyError, TypeError, ValueError)):
        description = RobotDescription.from_json(header.documents["robot"])
        remote = bool(json.loads(header.documents["controllers"])["remote"])
        policies = {
            name: load_policy(decode(one["contract"], "recording"), policy, recorded_motion(header, one["motion"]))
            for name, one in json.loads(header.documents.get("policies", "{}")).items()
        }
    return build_supervisor(
        description, header.control_period, policies or recorded_policy(header, policy), remote=remote
    )
