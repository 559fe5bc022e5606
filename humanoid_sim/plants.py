"""`python -m humanoid_sim.plants`: what a faster plant costs in truth, for a robot, a policy and its motion."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_POLICY, policy_path, sample_policy
from humanoid_sim.cli import run_program
from humanoid_sim.command_line import parse
from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.accuracy import PlantError, commanded_motion, describe_error, plant_errors
from humanoid_sim.files import finite
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.session.sources import parse_velocity
from humanoid_sim.simulation.plant import Actuation, timestep_of

_STEPS = (0.00125, 0.0025, 0.005)
"""s, of the implicit plant, unless others are given."""
_BRIEF = 2.0
"""s of the motion that are enough for a notice."""


@dataclass(frozen=True)
class PlantsConfig:
    """Measure how far the plants are from the solution that they come to as their steps get shorter.

    A policy runs once on the affine plant; its commands are then given to every plant, so the differences are the
    plants' alone. A floating base hangs on its support meanwhile. The reference (qfrc_applied) and affine agree step
    for step; implicit takes longer steps. Speeds are of this machine as it is now.
    """

    policy: str | None = None
    """ONNX checkpoint, or a shipped policy ({policies}). Default: the one for the robot."""
    robot: str = "lite"
    """A shipped robot ({robots}), robot_descriptions:NAME, a YAML file or an MJCF."""
    motion: str | None = None
    """Motion that the policy follows: a sample motion or a file. Default: wave for the sample policy, else its own."""
    command: str = "0.3,0,0"
    """Velocity command vx,vy,wz in m/s, m/s and rad/s, of a policy that walks."""
    seconds: float = 8.0
    """Length of the part of the motion that is played."""
    step: tuple[float, ...] = _STEPS
    """Physics steps of the implicit plant, s; those that do not divide the policy's period are left out."""
    json: bool = False
    """Print the result as JSON."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (("--robot lite --motion wave", "the sample policy's"),)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `plants` with command-line arguments; returns the exit status."""
    config = parse(PlantsConfig, "plants", arguments)
    if not (math.isfinite(config.seconds) and config.seconds > 0.0):
        raise InputError(f"--seconds: is {config.seconds}, expected a finite number > 0")
    for step in config.step:
        if not (math.isfinite(step) and step > 0.0):
            raise InputError(f"--step: is {step}, expected finite numbers > 0")
    description = load_robot(config.robot)
    path = sample_policy(description.name) if config.policy is None else policy_path(config.policy)
    motion = SAMPLE_MOTION if config.motion is None and path == SAMPLE_POLICY else config.motion
    checkpoint = load_checkpoint(path, None, description.joint_names)
    scenario = make_scenario(checkpoint, description, motion)
    period = scenario.contract.policy_dt
    velocity = parse_velocity(config.command, scenario.contract.command_ranges)
    commanded = commanded_motion(
        scenario.description, scenario.wiring, scenario.policy, config.seconds, velocity.tolist()
    )
    plants: list[tuple[Actuation, float | None]] = [("qfrc_applied", None), ("affine", None)]
    plants += [("implicit", step) for step in config.step if _divides(period, step)]
    errors = plant_errors(commanded, plants)
    what = {
        "policy": str(path),
        "robot": description.name,
        "motion": motion or None,
        "seconds": len(commanded.commands) * period,
    }
    if config.json:
        print(json.dumps({**what, "plants": [finite(asdict(error)) for error in errors]}, indent=1))
    else:
        _print(what, errors)
    return 0


def measured_cost(
    checkpoint: Checkpoint,
    description: RobotDescription,
    motion: Motion | None,
    actuation: Actuation,
    timestep: float | None,
) -> str:
    """Say in a line, for whoever chooses an approximate plant, its error over the first seconds of this motion.

    The physics step is in s; None for the plant's own.
    """
    try:
        scenario = make_scenario(checkpoint, description, motion)
        commanded = commanded_motion(scenario.description, scenario.wiring, scenario.policy, _BRIEF)
        (error,) = plant_errors(commanded, [(actuation, timestep)])
    except InputError as problem:
        step = timestep_of(description, actuation, timestep)
        return f"{actuation} plant, physics step {step:g} s: its error could not be measured: {problem}"
    return describe_error(error, f"the first {len(commanded.commands) * commanded.period:g} s")


def _divides(period: float, step: float) -> bool:
    try:
        steps_per_period(period, step)
    except InputError:
        return False
    return True


def _print(what: dict[str, Any], errors: Sequence[PlantError]) -> None:
    motion = f", motion {what['motion']}" if what["motion"] else ""
    print(f"{what['policy']} on {what['robot']}{motion}, {what['seconds']:g} s; errors against the converged solution")
    joints = f"{'joints, mrad RMS':>18}{'at most':>9}"
    print(f"{'plant':<14}{'step, ms':>9}{'hands, mm RMS':>15}{'at most':>9}{joints}{'speed':>8}")
    for e in errors:
        print(
            f"{e.actuation:<14}{1e3 * e.timestep:>9.4g}{1e3 * e.hands_rms:>15.2f}{1e3 * e.hands_most:>9.2f}"
            f"{1e3 * e.joints_rms:>18.2f}{1e3 * e.joints_most:>9.1f}{e.speed:>7.0f}x"
        )


if __name__ == "__main__":
    sys.exit(run_program(main))
