"""What a run's recording says about it."""

from __future__ import annotations

import platform
import sys
import time
from dataclasses import asdict

import mujoco
import numpy as np

from humanoid_sim import __version__
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.policies import PolicyChoice
from humanoid_sim.policy.motion import motion_bytes
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.session.sink import SessionHeader
from humanoid_sim.stack import MOTION_ATTACHMENT, header_documents

__all__ = ["session_header"]


def session_header(
    config: PlayConfig, description: RobotDescription, policy: PolicyChoice, control_period: float, use_remote: bool
) -> SessionHeader:
    """Everything that interprets the run, and repeats it."""
    settings: dict[str, object] = {
        "program": f"humanoid_sim.play {__version__}",
        "options": asdict(config),
        "policy": policy.checkpoint.source,
        "policy_sha256": policy.checkpoint.sha256,
        "motion": None if policy.motion_file is None else str(policy.motion_file),
        "versions": {"python": sys.version.split()[0], "mujoco": mujoco.__version__, "numpy": np.__version__},
        "platform": platform.platform(),
    }
    attachments = {} if policy.motion is None else {MOTION_ATTACHMENT: motion_bytes(policy.motion)}
    layout = policy.loaded.layout
    return SessionHeader(
        robot=description.name,
        joint_names=description.joint_names,
        control_period=control_period,
        start_time_ns=time.time_ns(),
        documents=header_documents(
            description, policy.loaded, remote=use_remote, settings=settings, action_limit=config.action_limit
        ),
        attachments=attachments,
        observation_terms=tuple((term.name, term.width) for term in layout.terms),
    )
