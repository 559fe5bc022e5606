"""Bases of environments: what can be copied, and what a policy's have in common, for one robot or many.

An environment that is pickled or deep-copied is built again from its arguments, then put into the same state. What it
holds beside that state (MuJoCo's threads, views into its memory, windows) cannot be copied, and need not be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Self

from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs.curriculum import Amounts, Curriculum, amounts_at
from humanoid_sim.envs.episode_robot import EpisodeRobot, RandomisedRobot
from humanoid_sim.envs.privileged import Privileged, PrivilegedTerm
from humanoid_sim.envs.scenario import Motions, Named, check_options, make_scenario
from humanoid_sim.envs.spaces import observation_space
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch import BatchSimulation


class CopyableEnv:
    """First base of an environment that can be copied in the middle of an episode; both then go on alike.

    A copy reads files that were named to the first one again, opens no window before it shows something, and is closed
    where the first one was.
    """

    KEPT: tuple[str, ...] = ()
    """Attributes that make up its state, beside those of `_snapshot`."""
    max_episode_steps: int
    """Steps after which every episode is truncated, if it is not over before."""
    _arguments: tuple[tuple[Any, ...], dict[str, Any]]
    _given_spec: EnvSpec | None = None

    def __new__(cls, *arguments: Any, **options: Any) -> Self:
        """Keep what it is built from."""
        self = super().__new__(cls)
        self._arguments = arguments, options
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """For `pickle` and `copy`."""
        arguments, options = self._arguments
        return partial(type(self), *arguments, **options), (), self.snapshot()

    def __setstate__(self, snapshot: dict[str, Any]) -> None:
        """For `pickle` and `copy`, of one that was just built."""
        self.restore(snapshot)

    @property
    def spec(self) -> EnvSpec | None:
        """Return what Gymnasium made it from, with the length of its episodes; None if it was built directly."""
        return self._given_spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec = replace(spec, max_episode_steps=self.max_episode_steps)
        self._given_spec = spec

    def snapshot(self) -> dict[str, Any]:
        """Its present state, for `restore` of one that was built alike; shares arrays with it until it is pickled."""
        common = ("_np_random", "_np_random_seed", "_given_spec", "action_space", "observation_space", "fault_count")
        return {name: vars(self)[name] for name in (*common, *self.KEPT) if name in vars(self)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take over a state."""
        vars(self).update(snapshot)


class PolicyEnvironment(CopyableEnv):
    """Base of `PolicyEnv` and `PolicyVectorEnv`."""

    _robots: EpisodeRobot | RandomisedRobot | BatchSimulation

    def _prepare(
        self,
        contract: Named | PolicyContract,
        robot: Named | RobotDescription,
        motion: Motions | None,
        curriculum: Curriculum | None,
        privileged: Sequence[str] | Mapping[str, PrivilegedTerm],
        options: Mapping[str, Any],
    ) -> Box:
        """Make the scenario, of options as `make_scenario` takes them; returns the observation space of one robot."""
        check_options(options, type(self), make_scenario)
        self.scenario = scenario = make_scenario(contract, robot, motion, **options)
        self.privileged = Privileged(privileged, is_floating=scenario.description.is_floating) if privileged else None
        """Observation of the critic; None where it sees what the policy does."""
        self.fault_count = 0
        """Episodes that a fault has ended so far."""
        self._curriculum, self._progress = curriculum, 0.0
        self._amounts()
        self._loop: ClosedLoop | None = None
        bounds = observation_space(scenario.wiring, scenario.description)
        self._low, self._high = bounds.low, bounds.high
        return bounds

    @property
    def progress(self) -> float:
        """Progress of training in [0, 1], which whoever trains sets: it decides the curriculum of the next episodes."""
        return self._progress

    @progress.setter
    def progress(self, progress: float) -> None:
        if not (isinstance(progress, int | float) and 0.0 <= progress <= 1.0):
            raise InputError(f"progress: is {progress!r}, expected a number from 0 to 1")
        self._progress = float(progress)

    def _amounts(self) -> Amounts:
        return amounts_at(self._curriculum, self._progress)

    def snapshot(self) -> dict[str, Any]:
        """See `CopyableEnv.snapshot`."""
        loop = None if self._loop is None else self._loop.snapshot()
        return super().snapshot() | {"_robots": self._robots.snapshot(), "_loop": loop}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """See `CopyableEnv.restore`."""
        kept = dict(snapshot)
        self._robots.restore(kept.pop("_robots"))
        loop, wiring, live = kept.pop("_loop"), self.scenario.wiring, self.scenario.live
        self._loop = None if loop is None else ClosedLoop.resumed(self._robots, wiring, loop, live)
        super().restore(kept)
