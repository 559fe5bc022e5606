"""Figures of walking policies: commands held, pushes, friction and mass, on the affine plant at the robot's own step.

The affine plant agrees with the reference to 1e-9 per step; nothing here was seen in training at that step.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.policy_step import shown_phase
from humanoid_sim.envs.scenario import Scenario, make_scenario
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.failure import has_fallen
from humanoid_sim.evaluation.feet import Feet, find_feet
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.onnx_policy import onnx_runtime
from humanoid_sim.simulation.batch import BatchSimulation, Randomisation
from humanoid_sim.simulation.floating_base import StartPose
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.plant import BatchActuation
from humanoid_sim.simulation.push import PUSH_DURATION, push_wrench

__all__ = ["CASES", "CaseResult", "WalkingCase", "evaluate_walking", "run_case"]

_SETTLE = 2.0
"""s at the start that errors do not count: the robot begins at rest."""
_AT_LIMIT = 0.99
"""Share of its effort limit from which on a joint counts as being at it."""
_CLEARANCE = 0.005
"""m: a foot in the middle of its swing that is lower than this scuffs."""
_MIDDLE = 0.6
"""Sine of the phase from which on a swing is in its middle."""
_SOLE_FRICTION = 0.6
"""Coefficient of the robot's own soles."""
_PUSH_AT = 5.0
"""s, of the first robot."""
_PUSHES_APART = 5
"""Policy steps from one robot's push to the next one's, within a gait cycle: feet are elsewhere in each."""


@dataclass(frozen=True, slots=True)
class WalkingCase:
    """Robots that differ in their seeds alone."""

    name: str
    command: tuple[float, float, float]
    """vx, vy in m/s and yaw rate in rad/s."""
    seconds: float = 20.0
    velocity_push: float = 0.0
    """m/s by which all bodies of the robot are faster at once, as training elsewhere pushes; each seed's in another
    direction, evenly all around."""
    force_push: float = 0.0
    """m/s, likewise: a force on the base for 0.1 s with the momentum that the whole robot would have then, which `play
    --push` applies. The base is faster than that afterwards, and turns."""
    friction: float | None = None
    """Coefficient of the soles on the floor; None: the robot's own."""
    mass: float = 1.0
    """Factor on the mass of every body."""


CASES = (
    WalkingCase("stand", (0.0, 0.0, 0.0), 60.0),
    WalkingCase("forward 0.6", (0.6, 0.0, 0.0)),
    WalkingCase("forward 0.3", (0.3, 0.0, 0.0)),
    WalkingCase("backward 0.3", (-0.3, 0.0, 0.0)),
    WalkingCase("left 0.2", (0.0, 0.2, 0.0)),
    WalkingCase("right 0.2", (0.0, -0.2, 0.0)),
    WalkingCase("turn left 0.5", (0.0, 0.0, 0.5)),
    WalkingCase("turn right 0.5", (0.0, 0.0, -0.5)),
    WalkingCase("velocity push 0.4, standing", (0.0, 0.0, 0.0), 10.0, velocity_push=0.4),
    WalkingCase("velocity push 0.4, forward 0.3", (0.3, 0.0, 0.0), 10.0, velocity_push=0.4),
    WalkingCase("force push 0.2, standing", (0.0, 0.0, 0.0), 10.0, force_push=0.2),
    WalkingCase("force push 0.2, forward 0.3", (0.3, 0.0, 0.0), 10.0, force_push=0.2),
    WalkingCase("force push 0.4, standing", (0.0, 0.0, 0.0), 10.0, force_push=0.4),
    WalkingCase("force push 0.4, forward 0.3", (0.3, 0.0, 0.0), 10.0, force_push=0.4),
    WalkingCase("friction 0.3, forward 0.4", (0.4, 0.0, 0.0), friction=0.3),
    WalkingCase("friction 0.5, forward 0.4", (0.4, 0.0, 0.0), friction=0.5),
    WalkingCase("friction 1.2, forward 0.4", (0.4, 0.0, 0.0), friction=1.2),
    WalkingCase("mass -10 %, forward 0.4", (0.4, 0.0, 0.0), mass=0.9),
    WalkingCase("mass +10 %, forward 0.4", (0.4, 0.0, 0.0), mass=1.1),
)
"""Cases by which the shipped policy is measured."""


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Figures over all seeds of a case; errors and the gait of those that stayed up."""

    name: str
    seeds: int
    survived: int
    speed_error: float
    """m/s, of the horizontal velocity in the heading frame, averaged over a gait cycle; mean over time and seeds."""
    worst_speed_error: float
    """m/s, the same of the worst seed."""
    yaw_error: float
    """rad/s, likewise."""
    worst_yaw_error: float
    at_limit: float
    """Share of the time at its effort limit, of the joint that is there most."""
    limited_joint: str
    scuffed: float
    """Share of the middle of all swings in which the swinging foot is lower than 5 mm."""
    touchdown: float
    """m/s, mean downward speed of a foot's lowest point in the step before it touches the floor."""
    drift: float
    """m, mean distance from the start at the end."""


@dataclass(slots=True)
class _Record:
    """One value for every policy step, shape (T, N, …)."""

    velocity: list[FloatArray] = field(default_factory=list)
    torque: list[FloatArray] = field(default_factory=list)
    height: list[FloatArray] = field(default_factory=list)
    swing: list[FloatArray] = field(default_factory=list)


def evaluate_walking(
    policy: Path, seeds: int, only: str | None, output: Path | None, actuation: BatchActuation = "affine"
) -> int:
    """Measure a policy and print the table; returns the exit status.

    Raises `InputError` if the policy cannot be read, or nothing was selected.
    """
    if seeds < 1:
        raise InputError(f"--seeds: is {seeds}, expected at least 1")
    cases = [case for case in CASES if only is None or only in case.name]
    if not cases:
        raise InputError(f"--only: is '{only}', expected part of one of {', '.join(case.name for case in CASES)}")
    if output is not None:
        output_file(output, "--json", ".json")
    scenario = make_scenario(policy, "lite_biped", task="velocity", actuation=actuation)
    measures = f"{'at limit':>10}{'scuffed':>9}{'touch, m/s':>12}"
    print(f"{'case':<32}{'stayed up':>10}{'speed, m/s':>12}{'yaw, rad/s':>12}{measures}")
    results = []
    for case in cases:
        result = run_case(scenario, policy, case, range(seeds))
        results.append(result)
        print(
            f"{result.name:<32}{result.survived:>7}/{result.seeds:<2}{result.speed_error:>12.3f}"
            f"{result.yaw_error:>12.3f}{100 * result.at_limit:>8.2f} %{100 * result.scuffed:>7.1f} %"
            f"{result.touchdown:>12.2f}",
            flush=True,
        )
    if output is not None:
        with whole_file(output) as file:
            file.write(json.dumps([asdict(result) for result in results], indent=1).encode())
    return 0


def run_case(scenario: Scenario, policy: Path, case: WalkingCase, seeds: Sequence[int]) -> CaseResult:
    """Run one robot per seed.

    Args:
        scenario: of the policy on its robot.
        policy: its file.
        case: what they do.
        seeds: of starts; the i-th of n robots is pushed in the direction 2π i / n, each with its feet elsewhere.
    """
    session = onnx_runtime().InferenceSession(str(policy), providers=["CPUExecutionProvider"])
    source = session.get_inputs()[0].name
    description, contract, count = scenario.description, scenario.contract, len(seeds)
    feet = find_feet(description)
    factor = 1.0 if case.friction is None else case.friction / _SOLE_FRICTION
    simulation = BatchSimulation(
        description,
        count,
        control_period=contract.policy_dt,
        physics_timestep=scenario.physics_timestep,
        actuation="implicit" if scenario.actuation == "implicit" else "affine",
        bodies=feet.bodies,
        randomisation=Randomisation(friction=(factor, factor), mass=(case.mass, case.mass)),
        seeds=list(seeds),
    )
    with closing(simulation):
        starts = [scenario.task.start(np.random.default_rng(seed).random(scenario.task.draws)) for seed in seeds]
        simulation.reset(
            joint_position=np.stack([start.joint_position for start in starts]),
            joint_velocity=np.stack([start.joint_velocity for start in starts]),
            base_yaw=np.stack([start.base_yaw for start in starts]),
        )
        loop = ClosedLoop(simulation, scenario.wiring, np.tile(case.command, (count, 1)), guards=scenario.guards)
        record, alive = _Record(), np.ones(count, dtype=np.bool_)
        model = build_model(description, scene="floor")
        standing = StartPose(model, description, joint_addresses(model, description.joint_names)).standing_height
        begin = simulation.qpos[:, :2].copy()
        pushes = _Pushes(case, scenario, simulation, model.body_subtreemass[model.body(description.base.body).id])
        for step in range(round(case.seconds / contract.policy_dt)):
            (action,) = session.run(None, {source: loop.observation})
            loop.act(np.asarray(action), wrench=pushes.begin(step), where=alive)
            base = simulation.base
            assert base is not None
            alive = alive & ~has_fallen(base, standing) & ~simulation.fault & ~np.asarray(loop.tripped)
            _take(record, scenario, loop, simulation, feet)
            if not alive.any():
                break
        drift = np.sqrt(((simulation.qpos[:, :2] - begin) ** 2).sum(axis=1))
    return _result(case, scenario, record, alive, drift)


class _Pushes:
    """Pushes each robot of a case once."""

    def __init__(self, case: WalkingCase, scenario: Scenario, simulation: BatchSimulation, mass: float) -> None:
        self._case, self._simulation = case, simulation
        policy_dt, robots = scenario.contract.policy_dt, np.arange(simulation.count)
        self._first = round(_PUSH_AT / policy_dt) + _PUSHES_APART * robots % _gait_cycle(scenario)
        self._duration = round(PUSH_DURATION / policy_dt)
        angle = 2.0 * np.pi * robots / simulation.count
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        self._change = case.velocity_push * np.pad(direction, ((0, 0), (0, 1)))
        self._wrench = push_wrench(case.force_push * direction, case.mass * mass)

    def begin(self, step: int) -> FloatArray | None:
        """Change velocities where a policy step begins with that; the wrenches in it, shape (N, 6), N and N·m."""
        since = (step - self._first)[:, None]
        if self._case.velocity_push and (since == 0).any():
            self._simulation.speed_up(np.where(since == 0, self._change, 0.0))
        return np.where((since >= 0) & (since < self._duration), self._wrench, 0.0) if self._case.force_push else None


def _gait_cycle(scenario: Scenario) -> int:
    """Policy steps."""
    phase = scenario.contract.phase
    return round((phase.period if phase and phase.period else 0.5) / scenario.contract.policy_dt)


def _take(record: _Record, scenario: Scenario, loop: ClosedLoop, simulation: BatchSimulation, feet: Feet) -> None:
    base, contract = simulation.base, scenario.contract
    assert base is not None
    record.velocity.append(base.planar_velocity)
    record.torque.append(np.abs(simulation.effort) / np.array(scenario.description.effort_limit))
    points = feet.place(*simulation.body_poses())[..., 2] - feet.floor - feet.radius
    owner = np.array(feet.foot)
    record.height.append(np.stack([points[:, owner == i].min(axis=1) for i in range(len(feet.bodies))], axis=1))
    phase = np.full((simulation.count, 1), np.nan)
    if contract.phase is not None and loop.velocity.any():  # nothing has to swing where all are to stand
        phase = shown_phase(contract.phase, loop.memory.walked, loop.velocity, contract.policy_dt)[:, :1]
    record.swing.append(np.sin(phase) * np.array([1.0, -1.0]))


def _result(
    case: WalkingCase, scenario: Scenario, record: _Record, alive: npt.NDArray[np.bool_], drift: FloatArray
) -> CaseResult:
    policy_dt = scenario.contract.policy_dt
    settled = round(_SETTLE / policy_dt)
    velocity, torque, height, swing = (
        np.array(each)[settled:] for each in (record.velocity, record.torque, record.height, record.swing)
    )
    if not alive.any() or not len(velocity):
        nan = float("nan")
        return CaseResult(case.name, len(alive), int(alive.sum()), nan, nan, nan, nan, nan, "", nan, nan, nan)
    error = np.abs(_averaged(velocity[:, alive], _gait_cycle(scenario)) - case.command)
    speed, yaw = np.sqrt((error[..., :2] ** 2).sum(axis=-1)).mean(axis=0), error[..., 2].mean(axis=0)
    at_limit = (torque[:, alive] > _AT_LIMIT).mean(axis=(0, 1))
    worst = int(np.argmax(at_limit))
    height, middle = height[:, alive], swing[:, alive] > _MIDDLE
    landing = (height[:-1] > _CLEARANCE) & (height[1:] <= _CLEARANCE)
    fall = (height[:-1] - height[1:]) / policy_dt
    return CaseResult(
        name=case.name,
        seeds=len(alive),
        survived=int(alive.sum()),
        speed_error=float(speed.mean()),
        worst_speed_error=float(speed.max()),
        yaw_error=float(yaw.mean()),
        worst_yaw_error=float(yaw.max()),
        at_limit=float(at_limit[worst]),
        limited_joint=scenario.description.joint_names[worst],
        scuffed=float((height[middle] < _CLEARANCE).mean()) if middle.any() else 0.0,
        touchdown=float(fall[landing].mean()) if landing.any() else 0.0,
        drift=float(drift[alive].mean()),
    )


def _averaged(values: FloatArray, width: int) -> FloatArray:
    """Return the mean of `width` consecutive rows, shape (T - width + 1, …)."""
    width = min(width, len(values))
    summed = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    mean: FloatArray = (summed[width:] - summed[:-width]) / width
    return mean
