"""One simulated robot: the control loop of `play` and an environment's step, against the bare physics they contain."""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import sleep
from typing import Any

import gymnasium
import mujoco
import numpy as np

from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_POLICY, motion_path
from humanoid_sim.controllers.supervisor import Supervisor, SupervisorMemory
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.messages import Intent, Mode, TickInput, TickRecord
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.feed import FeedWriter
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session
from humanoid_sim.session.sinks import Sink
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.stack import build_supervisor, run_header
from tools.bench.timing import Row, paired_ratio, row_of, seconds

__all__ = ["control_tick", "environment_step", "feed_cost", "real_time_factor", "recorder_cost", "supervisor_step"]

_BLOCK = 2000
"""Ticks that are timed together: long compared with the 20 ms after which the recorder looks at its queue."""
_STEPS = 100
"""Policy steps of the environment that are timed together: the first of the motion."""


@dataclass(slots=True)
class _Rig:
    """The Lite with the sample policy, in LOCOMOTION."""

    session: Session
    robot: MujocoRobot
    supervisor: Supervisor
    checkpoint: Checkpoint
    loaded: LoadedPolicy
    recorder: McapRecorder | None
    feed: FeedWriter | None

    def block(self) -> None:
        """Ticks, and the end of their recording."""
        for _ in range(_BLOCK):
            self.session.tick(())
        while self.recorder is not None and self.recorder.backlog:
            sleep(0.0005)


@contextmanager
def _rig(record: bool, *, publish: bool = False, watch: Sink | None = None) -> Iterator[_Rig]:
    description = load_robot("lite")
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    motion = read_motion(motion_path(SAMPLE_MOTION))
    loaded = load_policy(checkpoint.contract, checkpoint.policy, motion)
    period = 1.0 / description.simulation.control_frequency
    supervisor = build_supervisor(description, period, loaded)
    robot = MujocoRobot(description, control_period=period)
    with tempfile.TemporaryDirectory() as folder:
        header = run_header(description, period, loaded, motion, settings={})
        feed = FeedWriter(header) if publish else None
        encoded = (lambda _: None) if feed is None else feed.encoded
        recorder = McapRecorder(Path(folder) / "bench.mcap", encoded=encoded) if record else None
        sinks: list[Sink] = [sink for sink in (feed, recorder, watch) if sink is not None]
        settings = LoopSettings(period, realtime=False, simulated=True)
        session = Session(robot, supervisor, settings, header=header, sinks=sinks, qpos=lambda: robot.qpos)
        for sink in sinks:
            sink.start(header)
        robot.activate()
        try:
            _walk_to_locomotion(session, description.standby_controller_a.segment_durations, period)
            yield _Rig(session, robot, supervisor, checkpoint, loaded, recorder, feed)
        finally:
            robot.close()
            for sink in sinks:
                sink.close()


def _walk_to_locomotion(session: Session, durations: tuple[float, ...], period: float) -> None:
    session.tick((Intent.DAMP,))
    session.tick((Intent.LOAD_A,))
    for _ in range(round(sum(durations) / period) + 2):
        session.tick(())
    session.tick((Intent.START_LOCOMOTION,))
    if session.mode is not Mode.LOCOMOTION:
        raise AssertionError(f"the sample policy did not start: mode is {session.mode.name}")


def control_tick(repetitions: int) -> list[Row]:
    """One simulated control tick of `play`, feed and recording included, over `mj_step`s and inference in it."""
    with _rig(record=True, publish=True) as rig:
        robot = rig.robot
        model, data = robot.model, mujoco.MjData(robot.model)
        policy, decimation = rig.checkpoint.policy, round(rig.loaded.contract.policy_dt / robot.control_period)
        observation = np.zeros(rig.checkpoint.observation_width or 0, dtype=np.float32)

        def bare() -> None:
            mujoco.mj_copyData(data, model, robot.data)
            for tick in range(_BLOCK):
                mujoco.mj_step(model, data, robot.physics_steps)
                if tick % decimation == 0:
                    policy(observation, 0)

        def describe(ours: float, bare_time: float) -> str:
            return f"{1e6 * ours / _BLOCK:.0f} µs per tick, {1e6 * bare_time / _BLOCK:.0f} µs bare"

        return [paired_ratio("control tick of play at 200 Hz", rig.block, bare, repetitions, 2.5, describe)]


def recorder_cost(repetitions: int) -> list[Row]:
    """Return what recording adds to a control tick, the writer's own thread included."""
    with _rig(record=True) as recorded, _rig(record=False) as silent:
        pairs = [(seconds(recorded.block), seconds(silent.block)) for _ in range(repetitions + 1)][1:]
    return [row_of("recording, per tick", [1e6 * (a - b) / _BLOCK for a, b in pairs], "µs")]


def feed_cost(repetitions: int) -> list[Row]:
    """Time what publishing a tick costs the control thread: encoding, which a recording shares, and shared memory."""
    kept = _Kept()
    with _rig(record=False, publish=True, watch=kept) as rig:
        rig.block()
        feed = rig.feed
        assert feed is not None

        def block() -> None:
            for record in kept.records:
                feed.tick(record)

        values = [1e6 * seconds(block) / len(kept.records) for _ in range(repetitions + 1)][1:]
    return [replace(row_of("feed, per tick", values, "µs"), target=20.0)]


class _Kept(Sink):
    """Keeps ticks."""

    def __init__(self) -> None:
        self.records: list[TickRecord] = []

    def tick(self, record: TickRecord) -> None:
        self.records.append(record)


def supervisor_step(repetitions: int) -> list[Row]:
    """Return the pure stack alone, in every mode that a policy run passes through."""
    with _rig(record=False) as rig:
        state, safety = rig.robot.read()
        tick_input = TickInput(state, safety)
        step, memory = rig.supervisor.step, rig.supervisor.initial()
        memories: dict[str, SupervisorMemory] = {}
        for mode, intents in (("ZERO_TORQUE", ()), ("DAMPING", (Intent.DAMP,)), ("STANDBY", (Intent.LOAD_A,))):
            memories[mode] = memory = step(memory, TickInput(state, safety, intents))[0]
        memories["LOCOMOTION, command held"] = rig.session.memory

        def block(memory: SupervisorMemory) -> None:
            for _ in range(_BLOCK):
                step(memory, tick_input)

        return [
            row_of(
                f"supervisor step, {mode}",
                [1e6 * seconds(partial(block, held)) / _BLOCK for _ in range(repetitions + 1)],
                "µs",
            )
            for mode, held in memories.items()
        ]


def real_time_factor(repetitions: int) -> list[Row]:
    """Return how much faster than real time `play` simulates, publishes and records."""
    with _rig(record=True, publish=True) as rig:
        factors = [_BLOCK * rig.robot.control_period / seconds(rig.block) for _ in range(repetitions + 1)]
    return [row_of("play, times real time", factors, "×")]


def environment_step(repetitions: int) -> list[Row]:
    """`LiteTracking-v0.step` over the `mj_step`s in it: the sample policy's actions, and the same trajectory bare."""
    env = gymnasium.make("humanoid_sim/LiteTracking-v0")
    single = env.unwrapped
    assert isinstance(single, PolicyEnv)
    robot = single.robot
    actions, controls = _episode(env, single)
    model = copy.copy(robot.model)  # now, while the gains are in it: a reset takes them out
    data = mujoco.MjData(model)

    def begin() -> None:
        env.reset(seed=0)
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = robot.data.qpos, robot.data.qvel

    def steps() -> None:
        for action in actions:
            env.step(action)

    def bare() -> None:
        for control in controls:
            data.ctrl[:] = control
            mujoco.mj_step(model, data, robot.physics_steps)

    def describe(ours: float, physics: float) -> str:
        return f"{1e6 * ours / _STEPS:.0f} µs per step, {1e6 * physics / _STEPS:.0f} µs bare"

    begin()
    steps()
    bare()
    if not np.array_equal(data.qpos, robot.data.qpos):
        raise AssertionError("the bare physics does not match the environment")
    try:
        return [paired_ratio("LiteTracking-v0.step", steps, bare, repetitions, 1.4, describe, prepare=begin)]
    finally:
        env.close()


def _episode(env: gymnasium.Env[Any, Any], single: PolicyEnv) -> tuple[list[Any], list[Any]]:
    """Return the actions of the sample policy, and what the actuators are told in each step."""
    observation, info = env.reset(seed=0)
    actions, controls = [], []
    for _ in range(_STEPS):
        action = np.asarray(single.scenario.policy(observation, info["frame"]), dtype=np.float32)
        observation, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            raise AssertionError("the episode ended before the last of its steps")
        actions.append(action)
        controls.append(single.robot.data.ctrl.copy())
    return actions, controls
