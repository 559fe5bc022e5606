"""Find out what is wired wrongly in a policy that does not behave: try what usually is, one change at a time.

Nothing heavy is imported here: `--help` must be quick.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class DoctorConfig:
    """Find out what is wired wrongly in a policy that does not behave.

    Tries every usual mistake, one change of the contract at a time: on the samples of a trace, or else in one short
    simulated episode without support. Exit status 0 if nothing wrong was found, else 1.
    """

    checkpoint: tyro.conf.Positional[Path]
    """ONNX file, or a shipped policy."""
    robot: str
    """A shipped robot, robot_descriptions:NAME, a YAML file or an MJCF."""
    contract: Path | None = None
    """A contract.yaml with what the checkpoint does not say. Default: the one beside it."""
    motion: str | None = None
    """Motion to follow, if the checkpoint does not carry one: a sample motion, such as wave, or an .mcap
    file."""
    trace: Path | None = None
    """Samples of the trainer's environment (.npz): exact, and quicker than simulation."""
    json: bool = False
    """Print everything as JSON."""
