"""Common base of the environments of a policy, for one robot or many: scenario, curriculum, closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gymnasium.spaces import Box

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs.copying import CopyableEnv
from humanoid_sim.envs.curriculum import Amounts, Curriculum, amounts_at
from humanoid_sim.envs.episode_robot import EpisodeRobot
from humanoid_sim.envs.privileged import Privileged, PrivilegedTerm
from humanoid_sim.envs.randomised_robot import RandomisedRobot
from humanoid_sim.envs.scenario import Motions, Named, check_options, make_scenario
from humanoid_sim.envs.spaces import observation_space
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch import BatchSimulation


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
