"""A checkpoint as the control stack sees it: its contract, a callable, and where it came from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.files import is_file
from humanoid_sim.policy.motion import Motion

__all__ = ["Checkpoint", "file_digest"]


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A policy that is ready to run."""

    contract: PolicyContract
    policy: Policy
    source: str
    """Path, or `placeholder`."""
    sha256: str = ""
    """Of the file and of the external tensors beside it; empty for the placeholder."""
    observation_width: int | None = None
    """N as the model declares it; None if any width will do."""
    motion: Motion | None = None
    """The motion that the model carries in its graph; None if it carries none."""
    contract_file: Path | None = None
    """The contract.yaml that took part, beside the model or named; None without one."""
    golden: str = ""
    """What the golden vectors that were computed again are worth, in words; empty without any."""


def file_digest(path: Path) -> str:
    """SHA-256 of a checkpoint: its bytes, followed by those of `<name>.data` if that lies beside it."""
    digest = hashlib.sha256(path.read_bytes())
    external = path.with_name(path.name + ".data")
    if is_file(external):
        digest.update(external.read_bytes())
    return digest.hexdigest()
