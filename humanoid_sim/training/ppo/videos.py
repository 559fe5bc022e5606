"""Videos of a policy that is being trained: every so often an episode, drawn by a process of its own meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from humanoid_sim.controllers.base import RL_POLICY
from humanoid_sim.errors import InputError
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand
from humanoid_sim.rendering.video import VideoSink
from humanoid_sim.simulation.model import build_model
from humanoid_sim.training.ppo.environment import Subject
from humanoid_sim.training.ppo.learner import Float32Array

_SECONDS = 8.0
"""s of an episode that are shown, at most."""
_SHARE = 0.5
"""Share of the greatest forward command, for a policy that walks."""
_SIZE = 640, 360


class Videos:
    """A video now and then, when it is time for one."""

    def __init__(self, subject: Subject, folder: Path, minutes: float | None) -> None:
        """Make none before so many minutes; None: none at all.

        Raises:
            InputError: their folder cannot be made.
        """
        self._subject, self._folder = subject, folder / "videos"
        self._period = float("inf") if minutes is None else 60.0 * minutes
        self._due = time.monotonic() + self._period
        self._latest: VideoSink | None = None
        if minutes is not None:
            try:
                self._folder.mkdir(exist_ok=True)
            except OSError as error:
                raise InputError(f"{self._folder}: cannot be made a folder: {error.strerror}") from None

    def show(self, answer: Callable[[Float32Array], Float32Array], steps: int) -> None:
        """Run an episode and have it drawn, if it is time; waits for the last video, which is long ready as a rule.

        Raises:
            InputError: the last one could not be written.
        """
        if time.monotonic() < self._due:
            return
        self.close()
        robot, terrain = self._subject.scenario.description, self._subject.scenario.terrain
        path = self._folder / f"{steps:010d}.mp4"
        self._latest = VideoSink(path, lambda: build_model(robot, terrain=terrain), size=_SIZE)
        try:
            self._run(answer, self._latest, f"{steps} steps of training")
        except BaseException:
            self.abandon()
            raise
        self._due = time.monotonic() + self._period

    def close(self) -> None:
        """Wait for the one that is being drawn.

        Raises:
            InputError: it could not be written.
        """
        latest, self._latest = self._latest, None
        if latest is not None:
            latest.finish()

    def abandon(self) -> None:
        """Give up the one that is being drawn: nobody waits for it."""
        latest, self._latest = self._latest, None
        if latest is not None:
            latest.abandon()

    def _run(self, answer: Callable[[Float32Array], Float32Array], sink: VideoSink, caption: str) -> None:
        contract = self._subject.contract
        ranges = contract.command_ranges
        options = {}
        if self._subject.scenario.wiring.takes_velocity_command and ranges is not None:
            options["command"] = (_SHARE * ranges[0, 1], 0.0, 0.0)
        with closing(self._subject.environment()) as env:
            observation, _ = env.reset(seed=0, options=options)
            mode = ControlMode(Mode.LOCOMOTION, RL_POLICY, caption)
            command = MITCommand.zeros(len(env.robot.joints))
            for step in range(round(_SECONDS / contract.policy_dt)):
                tick = TickInput(env.robot.truth())
                sink.tick(TickRecord(step, tick, TickOutput(command, mode), 0.0, False, env.robot.qpos))
                observation, _, terminated, truncated, _ = env.step(answer(observation[None])[0])
                if terminated or truncated:
                    return
