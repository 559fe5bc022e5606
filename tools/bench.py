"""Measure this machine: what the product costs over the bare physics and inference that it contains.

`python -m tools.bench` prints a table. Ratios are taken pair by pair, the two sides in turn, so that a machine whose
speed drifts drifts for both.
"""

from __future__ import annotations

import copy
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium
import mujoco
import numpy as np
from msgspec.structs import replace as changed
from mujoco import rollout
from rich.console import Console
from rich.table import Table

from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_POLICY, motion_path
from humanoid_sim.cli import ExitStatus, parse, run_program
from humanoid_sim.controllers.policy_step import action_command
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode, TickInput, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.recording.sink import Sink
from humanoid_sim.regress.episodes import EpisodeBatch
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.suite import load_suite
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.feed import FeedWriter
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import build_supervisor, run_header

_TICKS = 2000  # timed together: long compared with the 20 ms after which the recorder looks at its queue
_EPISODE_STEPS = 100  # policy steps of one environment that are timed together
_VECTOR_STEPS = 2  # vector steps that are timed together
_SPREAD = np.float32(0.1)  # of random actions, as a share of the action space: small, so that nothing falls meanwhile
_EPISODES, _POLICY_STEPS = 1024, 5  # of the regression suite
_SECONDS = 60  # of the loop on mock motors
_SCRIPT = "hold 0.5; damp; hold 1; load_a; wait; start_locomotion; hold 100"


@dataclass(frozen=True)
class BenchOptions:
    """Measure this machine: what the product costs over the bare physics and inference that it contains."""

    repetitions: int = 15
    """Number of times to take each figure; the median counts."""
    only: str | None = None
    """Measure only the figures whose name contains this text."""
    json: bool = False
    """Print JSON instead of a table."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the table; an empty unit stands for a ratio."""

    name: str
    value: float
    detail: str = ""
    limit: float | None = None
    """Guide, not to be exceeded, or to be reached; None: for information."""
    at_least: bool = False
    unit: str = ""

    @property
    def is_met(self) -> bool:
        if self.limit is None:
            return True
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def seconds(action: Callable[[], object]) -> float:
    """Return the wall time of one call, s."""
    begin = perf_counter()
    action()
    return perf_counter() - begin


def compare(
    action: Callable[[], object],
    bare: Callable[[], object],
    repetitions: int,
    count: int,
    prepare: Callable[[], object] = lambda: None,
) -> tuple[float, str]:
    """Time two actions in turn, after one pair that is not counted.

    Args:
        count: items that each of them handles.
        prepare: called before each, untimed.

    Returns:
        The median of the ratios of their times, and the median times of an item in words.
    """

    def once(timed: Callable[[], object]) -> float:
        prepare()
        return 1e6 * seconds(timed) / count

    pairs = [(once(action), once(bare)) for _ in range(repetitions + 1)][1:]
    ours, theirs = (statistics.median(side) for side in zip(*pairs, strict=True))
    ratios = [a / b for a, b in pairs]
    return statistics.median(ratios), f"{ours:.1f} µs over {theirs:.1f} µs; {min(ratios):.2f} to {max(ratios):.2f}"


# --- one robot ---


class _Kept(Sink):
    def __init__(self) -> None:
        self.records: list[TickRecord] = []

    def tick(self, record: TickRecord) -> None:
        self.records.append(record)


@contextmanager
def _playing(*sinks: Sink) -> Iterator[tuple[Session, Supervisor, SimRobot]]:
    """Yield a session of the Lite with the sample policy, in LOCOMOTION, its stack and its robot."""
    description, checkpoint = load_robot("lite"), load_checkpoint(SAMPLE_POLICY)
    motion = read_motion(motion_path(SAMPLE_MOTION))
    loaded = load_policy(checkpoint.contract, checkpoint.policy, motion)
    period = 1.0 / description.simulation.control_frequency
    robot = SimRobot(description, SimConfig(control_period=period))
    header = run_header(description, period, loaded, settings={})
    with closing(robot):
        settings = LoopSettings(period, realtime=False, simulated=True)
        supervisor = build_supervisor(description, period, loaded)
        session = Session(robot, supervisor, settings, header=header, sinks=sinks, qpos=lambda: robot.qpos)
        for sink in sinks:
            sink.start(header)
        robot.activate()
        session.tick((Intent.DAMP,))
        session.tick((Intent.LOAD_A,))
        for _ in range(round(sum(description.standby_controller_a.segment_durations) / period) + 2):
            session.tick(())
        session.tick((Intent.START_LOCOMOTION,))
        assert session.mode is Mode.LOCOMOTION
        yield session, supervisor, robot


def _run(session: Session) -> None:
    for _ in range(_TICKS):
        session.tick(())


_SUBSCRIBER = """
import sys, time
from pathlib import Path
from humanoid_sim.client import Feed, SessionInfo
with Feed(SessionInfo(0, "", "", "", "", Path(sys.argv[1]))):
    print(flush=True)
    sys.stdin.readline()
"""


@contextmanager
def _feed(*, subscribed: bool = True) -> Iterator[FeedWriter]:
    """Yield a feed with one subscriber, another process; or without."""
    description, checkpoint = load_robot("lite"), load_checkpoint(SAMPLE_POLICY)
    loaded = load_policy(checkpoint.contract, checkpoint.policy, read_motion(motion_path(SAMPLE_MOTION)))
    header = run_header(description, 1.0 / description.simulation.control_frequency, loaded, settings={})
    with tempfile.TemporaryDirectory() as folder, closing(FeedWriter(Path(folder), header)) as feed:
        if not subscribed:
            yield feed
            return
        command = [sys.executable, "-c", _SUBSCRIBER, folder]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as subscriber:
            assert subscriber.stdout is not None
            subscriber.stdout.readline()
            yield feed
            subscriber.communicate("\n")


def control_tick(repetitions: int) -> Iterator[Figure]:
    """One simulated control tick of `play`, recorded, over the `mj_step`s and inference in it."""
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    for name, limit in (("control tick of play at 200 Hz", 2.5), ("control tick of play, one subscriber", None)):
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            feed = stack.enter_context(_feed(subscribed=limit is None))
            recorder = stack.enter_context(closing(McapRecorder(folder / "bench.mcap", inline=True)))
            session, _, robot = stack.enter_context(_playing(feed, recorder))
            data, decimation = mujoco.MjData(robot.model), round(checkpoint.contract.policy_dt / robot.control_period)
            observation = np.zeros(checkpoint.observation_width or 0, dtype=np.float32)

            def bare(robot: SimRobot = robot, data: Any = data, decimation: int = decimation) -> None:
                mujoco.mj_copyData(data, robot.model, robot.data)
                for tick in range(_TICKS):
                    mujoco.mj_step(robot.model, data, robot.physics_steps)
                    if tick % decimation == 0:
                        checkpoint.policy(observation, 0)  # noqa: B023

            yield Figure(name, *compare(partial(_run, session), bare, repetitions, _TICKS), limit)


def publishing(repetitions: int) -> Iterator[Figure]:
    """Return what publishing a tick costs the control thread."""
    kept = _Kept()
    with _feed() as feed, _playing(feed, kept) as (session, _, _):
        _run(session)

        def publish() -> None:
            for record in kept.records:
                feed.tick(record)

        values = [seconds(publish) for _ in range(repetitions)]
        yield Figure("publishing a tick", 1e6 * statistics.median(values) / len(kept.records), "", 40.0, unit="µs")


def supervisor_step(repetitions: int) -> Iterator[Figure]:
    """Return the time of the pure stack alone, in every mode that a policy run passes through."""
    with _playing() as (session, supervisor, robot):
        state, safety = robot.read()
        step, memory = supervisor.step, supervisor.initial()
        memories = {"LOCOMOTION, command held": session.memory, "ZERO_TORQUE": memory}
        for mode, intent in (("DAMPING", Intent.DAMP), ("STANDBY", Intent.LOAD_A)):
            memories[mode] = memory = step(memory, TickInput(state, safety, (intent,)))[0]
        calm = TickInput(state, safety)
        for mode, held in memories.items():
            values = [seconds(lambda: [step(held, calm) for _ in range(_TICKS)]) for _ in range(repetitions)]  # noqa: B023
            yield Figure(f"supervisor step, {mode}", 1e6 * statistics.median(values) / _TICKS, unit="µs")


def environment_step(repetitions: int) -> Iterator[Figure]:
    """`LiteTracking-v0.step` with the sample policy's actions, over as many `mj_step`s from the states on its way."""
    env: Any = gymnasium.make("humanoid_sim/LiteTracking-v0")
    robot, policy = env.unwrapped.robot, env.unwrapped.scenario.policy
    observation, info = env.reset(seed=0)
    actions, states = [], []
    for _ in range(_EPISODE_STEPS):
        actions.append(np.asarray(policy(observation, info["frame"]), dtype=np.float32))
        observation, _, terminated, truncated, info = env.step(actions[-1])
        assert not any((terminated, truncated)), "the episode ended before the last of its steps"
        states.append((robot.data.qpos.copy(), robot.data.qvel.copy()))
    model = copy.copy(robot.model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    data = mujoco.MjData(model)
    mujoco.mj_copyData(data, model, robot.data)

    def steps() -> None:
        for action in actions:
            env.step(action)

    def bare() -> None:
        for data.qpos[:], data.qvel[:] in states:
            mujoco.mj_step(model, data, robot.physics_steps)

    with closing(env):
        comparison = compare(steps, bare, repetitions, _EPISODE_STEPS, lambda: env.reset(seed=0))
        yield Figure("LiteTracking-v0.step", *comparison, 1.4)


# --- batches ---


class _BareRollout:
    """The same models, states, controls and threads as a batch simulation's, and nothing around them.

    Args:
        simulation: of N robots.
        models: N of them, with the gains in force.
        qpos: shape (N, nq), where it starts.
        qvel: shape (N, nv).
        targets: shape (N, n) each, rad, the positions that are commanded one control period after the other.
        reached: shape (N, nq), where the simulation ended.
    """

    def __init__(
        self,
        simulation: BatchSim,
        models: Sequence[mujoco.MjModel],
        qpos: FloatArray,
        qvel: FloatArray,
        targets: Sequence[FloatArray],
        reached: FloatArray,
    ) -> None:
        self._models = list(models)
        for each in self._models:
            each.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        model, steps = self._models[0], simulation.physics_steps
        stiffness = np.array([-each.actuator_biasprm[:, 1] for each in self._models])
        self._controls = [np.repeat((stiffness * target)[:, None], steps, axis=1) for target in targets]
        self._initial = np.zeros((simulation.count, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        self._initial[:, 1:] = np.concatenate([qpos, qvel], axis=1)
        self._path = np.zeros((simulation.count, steps, self._initial.shape[1]))
        self._data = [mujoco.MjData(model) for _ in range(simulation.threads)]
        self._rollout = rollout.Rollout(nthread=simulation.threads if simulation.threads > 1 else 0)
        self.close = self._rollout.close
        self.run()
        is_same = np.allclose(self._path[:, -1, 1 : 1 + model.nq], reached, rtol=0.0, atol=1e-9)
        assert is_same, "the bare physics does not match the batch"

    def run(self) -> None:
        """From the start through all control periods, one call each, as an answer to the state needs it."""
        state, velocity = self._initial, slice(1 + self._models[0].nq, None)
        options: dict[str, Any] = {"skip_checks": True, "state": self._path}
        warm = np.zeros_like(state[:, velocity])
        for control in self._controls:
            steps = control.shape[1]
            self._rollout.rollout(
                self._models, self._data, state, control, nstep=steps, initial_warmstart=warm, **options
            )
            state = self._path[:, -1].copy()
            warm = (state - self._path[:, -2])[:, velocity] / self._models[0].opt.timestep


class _Stepped:
    """Environments that are given the same actions from the same starts again and again."""

    def __init__(self, name: str, count: int, mode: str = "vector_entry_point", **options: Any) -> None:
        name = f"humanoid_sim/{name}"
        self.envs: Any = gymnasium.make_vec(name, num_envs=count, vectorization_mode=mode, **options)
        self.envs.action_space.seed(0)
        self.actions = [_SPREAD * self.envs.action_space.sample() for _ in range(_VECTOR_STEPS)]
        self.items = count * _VECTOR_STEPS
        self.begin()

    def begin(self) -> None:
        self.envs.reset(seed=0)

    def step(self) -> None:
        for action in self.actions:
            *_, terminated, truncated, _ = self.envs.step(action)
            assert not (terminated | truncated).any(), "the next step would do less than a step"

    def close(self) -> None:
        self.envs.close()

    def over(self, other: _Stepped, repetitions: int) -> tuple[float, str]:
        """Return how many times as fast these are."""

        def begin() -> None:
            self.begin()
            other.begin()

        return compare(other.step, self.step, repetitions, self.items, begin)


def vector_step(repetitions: int) -> Iterator[Figure]:
    """Vector steps over bare `mujoco.rollout`s of the same states and controls, and over `SyncVectorEnv`."""
    with closing(_Stepped("LiteTracking-v0", 1024)) as envs:
        simulation, wiring = envs.envs.unwrapped.simulation, envs.envs.unwrapped.scenario.wiring
        envs.step()
        reached = simulation.qpos.copy()
        models = [simulation.model(0)] * simulation.count  # now, while the gains are in it; all robots are alike
        envs.begin()
        targets = [action_command(wiring.action_map, action).position for action in envs.actions]
        with closing(_BareRollout(simulation, models, simulation.qpos, simulation.qvel, targets, reached)) as physics:
            comparison = compare(physics.run, envs.step, repetitions, envs.items, envs.begin)
        yield Figure("vector, 1024 environments, over bare rollout", *comparison, 0.85, at_least=True)
    # How many Gymnasium's own steps one by one makes no difference to the ratio.
    with (
        closing(_Stepped("LiteTracking-v0", 64)) as native,
        closing(_Stepped("LiteTracking-v0", 64, "sync")) as sync,
    ):
        yield Figure("vector, over SyncVectorEnv", *native.over(sync, repetitions), 1.9, at_least=True)


def implicit_plant(repetitions: int) -> Iterator[Figure]:
    """Environments with implicit damping at its own long step over the affine one at the robot's."""
    for name, limit in (("LiteTracking-v0", 4.0), ("BipedVelocity-v0", 3.0)):
        with (
            closing(_Stepped(name, 512, implicit=True)) as implicit,
            closing(_Stepped(name, 512)) as affine,
        ):
            yield Figure(f"implicit over affine, {name}", *implicit.over(affine, repetitions), limit, at_least=True)


def regress_speed(repetitions: int) -> Iterator[Figure]:
    """Policy steps of a suite, with inference, disturbances, measures and judging, over bare rollouts.

    The robots differ as the suite has it, except for the delay of their commands, which the bare physics lacks. What is
    built once per case is left out on both sides.
    """
    suite, folder = load_suite("lite_tracking")
    drawn = changed(suite.randomisation, delay=(0.0, 0.0))
    prepared = prepare_suite(changed(suite, cases=suite.cases[:1], randomisation=drawn), folder)
    (case,) = prepare_policy(prepared, SAMPLE_POLICY)
    case = replace(case, steps=_POLICY_STEPS)
    batch, scenario = EpisodeBatch(case, range(_EPISODES)), case.scenario
    starts: list[tuple[FloatArray, FloatArray]] = []
    actions: list[Any] = []

    def watched(observation: Any, frame: Any) -> Any:
        starts.append((batch.simulation.qpos.copy(), batch.simulation.qvel.copy()))
        actions.append(scenario.policy(observation, frame))
        return actions[-1]

    batch.case = replace(case, scenario=replace(scenario, policy=watched))
    batch.run()
    batch.case = case
    raw = np.array(actions).reshape(_POLICY_STEPS, _EPISODES, -1)
    targets = [action_command(scenario.wiring.action_map, action).position for action in raw]
    reached = batch.simulation.qpos.copy()
    models = [batch.simulation.model(i) for i in range(_EPISODES)]
    bare = _BareRollout(batch.simulation, models, *starts[0], targets, reached)
    with closing(batch.simulation), closing(bare) as physics:
        comparison = compare(physics.run, batch.run, repetitions, _EPISODES * _POLICY_STEPS)
    yield Figure(f"regress, {_EPISODES} episodes, over bare rollout", *comparison, 0.70, at_least=True)


# --- processes ---


def help_start(repetitions: int) -> Iterator[Figure]:
    """`play --help` over an interpreter that does nothing."""

    def run(*arguments: str) -> None:
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)

    comparison = compare(lambda: run("-m", "humanoid_sim.play", "--help"), lambda: run("-c", "pass"), repetitions, 1)
    yield Figure("play --help over python -c pass", *comparison, 15.0)


def hardware_loop(_: int) -> Iterator[Figure]:
    """Deadlines that 14 mock motors at 50 Hz miss in a minute, measured once."""
    options = f"--hardware virtual:bench --policy lite_tracking --duration {_SECONDS} --allow-script --script".split()
    with tempfile.TemporaryDirectory() as folder:
        outputs = ("--viewer", "none", "--record", "r.mcap", "--summary", "s.json")
        command = [sys.executable, "-m", "humanoid_sim.play", *options, _SCRIPT, *outputs]
        subprocess.run(command, check=True, cwd=folder, stdout=subprocess.DEVNULL)
        summary = json.loads(Path(folder, "s.json").read_text(encoding="utf-8"))
    loop = summary["loop"]
    fifo = next((one["message"] for one in summary["events"] if "SCHED_FIFO" in one["message"]), "no SCHED_FIFO")
    detail = f"of {loop['ticks']} ticks; tick {1e3 * summary['tick_time']['p99']:.1f} ms at 99 %; {fifo}"
    yield Figure(f"14 mock motors at 50 Hz, {_SECONDS} s: missed", float(loop["overruns"]), detail, 0.0)


BENCHMARKS: dict[str, Callable[[int], Iterator[Figure]]] = {
    "control tick": control_tick,
    "supervisor step": supervisor_step,
    "LiteTracking-v0.step": environment_step,
    "vector": vector_step,
    "regress": regress_speed,
    "implicit": implicit_plant,
    "play --help": help_start,
    "publishing": publishing,
    "mock motors": hardware_loop,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; the exit status is 1 if a guide was missed."""
    options = parse(BenchOptions, "tools.bench", arguments)
    chosen = [run for name, run in BENCHMARKS.items() if options.only is None or options.only in name]
    if not chosen or options.repetitions < 1:
        raise InputError(f"expected --repetitions >= 1, and --only part of one of {', '.join(BENCHMARKS)}")
    figures = [figure for run in chosen for figure in run(options.repetitions)]
    versions = " ".join(f"{name} {version(name)}" for name in ("mujoco", "onnxruntime", "humanoid_sim"))
    machine = f"{os.cpu_count()} CPUs, {platform.platform()}, python {platform.python_version()}, {versions}"
    if options.json:
        rows = [{"name": row.name, "value": row.value, "unit": row.unit, "met": row.is_met} for row in figures]
        print(json.dumps({"machine": machine, "rows": rows}, indent=1))
        return ExitStatus.of(all(row.is_met for row in figures))
    table = Table("figure", "measured", "guide", "", caption=machine)
    for row in figures:
        guide = "" if row.limit is None else f"{'≥' if row.at_least else '≤'} {row.limit:g}"
        colour = "green" if row.is_met else "red"
        table.add_row(row.name, f"[{colour}]{row.value:.2f}[/] {row.unit}", guide, row.detail)
    Console().print(table)
    return ExitStatus.of(all(row.is_met for row in figures))


if __name__ == "__main__":
    sys.exit(run_program(main))
