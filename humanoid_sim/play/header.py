"""What a run's recording says about it."""

from __future__ import annotations

import platform
import sys
import time
from dataclasses import asdict

import mujoco
import numpy as np

from humanoid_sim import __version__
from humanoid_sim.messages import SessionHeader
from humanoid_sim.play.plan import Plan
from humanoid_sim.policy.motion import motion_bytes
from humanoid_sim.stack import MOTION_ATTACHMENT, header_documents

__all__ = ["session_header"]


def session_header(plan: Plan) -> SessionHeader:
    """Everything that interprets the run, and repeats it. A real robot has been prepared: its checks are part of it."""
    config, description, policy, parts = plan.config, plan.description, plan.policy, plan.parts
    settings: dict[str, object] = {
        "program": f"humanoid_sim.play {__version__}",
        "options": asdict(config),
        "policy": policy.checkpoint.source,
        "policy_sha256": policy.checkpoint.sha256,
        "motion": None if policy.motion_file is None else str(policy.motion_file),
        "versions": {"python": sys.version.split()[0], "mujoco": mujoco.__version__, "numpy": np.__version__},
        "platform": platform.platform(),
        "checks": None if parts.bring_up is None else [": ".join(check) for check in parts.bring_up.checks()],
    }
    attachments = {} if policy.motion is None else {MOTION_ATTACHMENT: motion_bytes(policy.motion)}
    layout = policy.loaded.layout
    since_zero = float(parts.robot.read()[0].time)  # a real robot's clock runs already
    return SessionHeader(
        robot=description.name,
        joint_names=description.joint_names,
        control_period=plan.control_period,
        start_time_ns=time.time_ns() - round(1e9 * since_zero),
        documents=header_documents(
            description,
            policy.loaded,
            remote=config.remote != "none",
            settings=settings,
            action_limit=config.action_limit,
        ),
        attachments=attachments,
        observation_terms=tuple((term.name, term.width) for term in layout.terms),
    )
