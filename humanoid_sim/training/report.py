"""`evaluate`: rollouts of a policy and of the baseline over motions, as a table and as JSON."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.files import whole_file
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.training.config import EvaluateConfig
from humanoid_sim.training.evaluate import Rollout, TrackingFailedError, follow, inverse_kinematics_policy
from humanoid_sim.training.held_out import held_out_motions

__all__ = ["Figures", "evaluate"]


@dataclass(frozen=True, slots=True)
class Figures:
    """One motion, one policy; the errors are the hands'."""

    motion: str
    policy: str
    peak_hand_speed: float
    """m/s, of the reference."""
    position_rms: float
    """m"""
    position_max: float
    """m"""
    orientation_rms: float
    """rad"""
    orientation_max: float
    """rad"""
    command_rate: float
    """rad/s, root mean square."""

    @classmethod
    def of(cls, motion: str, policy: str, rollout: Rollout) -> Figures:
        """The figures of a rollout."""
        summary, hands = rollout.summary, rollout.summary.hands
        return cls(
            motion=motion,
            policy=policy,
            peak_hand_speed=summary.peak_speed,
            position_rms=hands.position_rms,
            position_max=hands.position_max,
            orientation_rms=hands.orientation_rms,
            orientation_max=hands.orientation_max,
            command_rate=rollout.command_rate,
        )


def evaluate(config: EvaluateConfig) -> int:
    """Measure, print, write; returns the exit status.

    Raises:
        InputError: if a file cannot be read or written, or does not fit the policy.
    """
    description = load_robot("lite")
    checkpoint = load_checkpoint(Path(config.policy) if config.policy else asset_path("policies", "lite_tracking.onnx"))
    if checkpoint.contract.task_type != "tracking":
        raise InputError(f"{checkpoint.source}: task_type is {checkpoint.contract.task_type}, expected tracking")
    if config.random < 0 or config.seed < 0:
        raise InputError(f"--random and --seed: are {config.random} and {config.seed}, expected at least 0")
    files = [Path(name) for name in config.motion] or sorted(asset_path("motions").glob("*.mcap"))
    motions = [(file.stem, read_motion(file)) for file in files]
    motions += [
        (f"random {i}", motion) for i, motion in enumerate(held_out_motions(description, config.random, config.seed))
    ]
    console = Console()
    rows: list[Figures] = []
    with console.status("") as status:
        for name, motion in motions:
            status.update(f"following {name}")
            try:
                rows += _measure(description, checkpoint, name, motion, config)
            except (InputError, TrackingFailedError) as error:
                raise InputError(f"{name}: {error}") from None
    console.print(_table(rows))
    if config.json:
        with whole_file(config.json) as file:
            file.write(json.dumps([asdict(row) for row in rows], indent=1).encode())
    return 0


def _measure(
    description: RobotDescription, checkpoint: Checkpoint, name: str, motion: Motion, config: EvaluateConfig
) -> list[Figures]:
    """The policy and the baseline on one motion."""
    contract = checkpoint.contract
    load_policy(contract, checkpoint.policy, motion)  # a motion that does not fit is refused before it is solved
    baseline = inverse_kinematics_policy(description, contract, motion)
    figures = []
    for label, policy in (("policy", checkpoint.policy), ("ik", baseline)):
        rollout = follow(
            description, contract, policy, motion, command_delay=config.command_delay, as_on_bus=config.bus
        )
        figures.append(Figures.of(name, label, rollout))
    return figures


def _table(rows: list[Figures]) -> Table:
    table = Table(title="hand tracking in closed loop")
    table.add_column("motion")
    table.add_column("policy")
    for heading in ("peak m/s", "rms cm", "max cm", "rms °", "max °", "command rad/s"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            row.motion,
            row.policy,
            f"{row.peak_hand_speed:.2f}",
            f"{100.0 * row.position_rms:.2f}",
            f"{100.0 * row.position_max:.2f}",
            f"{math.degrees(row.orientation_rms):.2f}",
            f"{math.degrees(row.orientation_max):.2f}",
            f"{row.command_rate:.3f}",
            end_section=row.policy == "ik",
        )
    return table
