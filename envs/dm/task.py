"""A policy's environment as a `dm_control` task, and its robot as a `dm_control` physics.

Import it through `humanoid_sim.envs.dm`, which settles what `dm_control` draws with.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from dm_control import mujoco
from dm_control.mujoco import wrapper
from dm_control.rl import control
from dm_env import specs
from gymnasium.spaces import Box

from humanoid_sim.envs.episode_robot import EpisodeRobot, RandomisedRobot
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.mit import Float32Array


class RobotPhysics(mujoco.Physics):
    """A robot's simulation, which its own code steps: a policy's command, held for one policy step.

    A simulation that is no longer sound is a fault that ends the episode, not a `PhysicsError`.
    """

    def __init__(self, robot: EpisodeRobot | RandomisedRobot, advance: Callable[[], None]) -> None:
        """Share the robot's model and data.

        Args:
            advance: takes one policy step with the action that the task was given.
        """
        super().__init__(wrapper.MjData(robot.data))
        self._advance = advance

    def step(self, nstep: int = 1) -> None:
        """One policy step, which is `nstep` physics steps."""
        self._advance()

    def after_reset(self) -> None:
        """Bring what derives from the start up to date for pictures, and keep where the solver begins."""
        accelerations = self.data.qacc.copy(), self.data.qacc_warmstart.copy()
        super().after_reset()
        self.data.qacc[:], self.data.qacc_warmstart[:] = accelerations

    def copy(self, share_model: bool = False) -> mujoco.Physics:
        """Return the present state as a physics of its own, which nothing commands."""
        return mujoco.Physics(self.data._make_copy(share_model=share_model))


class PolicyTask(control.Task):
    """`PolicyEnv` in the words of `dm_env`: the same starts, trajectories, rewards and ends.

    The observation is an ordered dictionary of the contract's terms, each with its history, or `observation` alone
    where steps, not terms, are kept together. The last time step of an episode has discount 0 where the robot has
    failed or a fault has ended the episode, and 1 where the motion or the time was over.
    """

    def __init__(self, env: PolicyEnv, seed: int | None) -> None:
        """Take over an environment.

        Args:
            seed: of its starts, None for any.
        """
        self.env = env
        self._seed = seed
        self._action = np.zeros(env.action_space.shape or (), dtype=np.float32)
        self._observation = np.zeros(env.observation_space.shape or (), dtype=np.float32)
        self._reward = 0.0
        self._discount: float | None = None
        layout = env.scenario.wiring.layout
        self._ends = {"observation": layout.width}
        if layout.history_layout == "per_term":
            ends = np.cumsum([term.width for term in layout.terms])
            self._ends = dict(zip((term.name for term in layout.terms), ends.tolist(), strict=True))

    def snapshot(self) -> dict[str, Any]:
        """Return the state of task and environment, for `restore` of a task that was built alike."""
        kept = {name: value for name, value in vars(self).items() if name not in ("env", "_ends")}
        return {"task": kept, "env": self.env.snapshot()}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a state."""
        for name, value in snapshot["task"].items():
            setattr(self, name, value)
        self.env.restore(snapshot["env"])

    def initialize_episode(self, physics: RobotPhysics) -> None:
        """Start the next episode; the seed counts once."""
        self._observation, _ = self.env.reset(seed=self._seed)
        self._seed, self._discount = None, None

    def before_step(self, action: npt.ArrayLike, physics: RobotPhysics) -> None:
        """Take an action; the physics' step lets it act."""
        self._action = np.asarray(action, dtype=np.float32)

    def advance(self) -> None:
        """One policy step with the latest action."""
        self._observation, self._reward, terminated, truncated, _ = self.env.step(self._action)
        self._discount = (0.0 if terminated else 1.0) if terminated or truncated else None

    def after_step(self, physics: RobotPhysics) -> None:
        """Nothing is left to do."""

    def action_spec(self, physics: RobotPhysics) -> specs.BoundedArray:
        """Shape (m,), raw actions, with the bounds of the Gymnasium environment."""
        space = self.env.action_space
        assert isinstance(space, Box)
        names = "\t".join(self.env.scenario.contract.action_joint_names)  # as dm_control names actuators
        return specs.BoundedArray(space.shape, np.float32, space.low, space.high, name=names)

    def get_observation(self, physics: RobotPhysics) -> OrderedDict[str, Float32Array]:
        """Return what the policy observes, term by term."""
        parts = np.split(self._observation, list(self._ends.values())[:-1])
        return OrderedDict((name, part.copy()) for name, part in zip(self._ends, parts, strict=True))

    def get_reward(self, physics: RobotPhysics) -> float:
        """Return the reward of the latest step."""
        return self._reward

    def get_termination(self, physics: RobotPhysics) -> float | None:
        """Return the last step's discount; None while the episode goes on."""
        return self._discount


class TaskEnvironment(control.Environment):
    """A `PolicyTask` with its physics. It can be pickled and deep-copied in an episode, as `CopyableEnv` can."""

    def __init__(self, again: Callable[[], TaskEnvironment], task: PolicyTask, **options: Any) -> None:
        """Put it together.

        Args:
            again: makes another one, as this was made; it can be pickled.
            options: as `control.Environment` takes them.
        """
        robot = task.env.robot
        super().__init__(RobotPhysics(robot, task.advance), task, n_sub_steps=robot.physics_steps, **options)
        self._again = again
        self._policy_task = task

    def __reduce__(self) -> tuple[Any, ...]:
        """For `pickle` and `copy`."""
        counters = {name: vars(self)[name] for name in ("_step_count", "_reset_next_step")}
        return self._again, (), (self._policy_task.snapshot(), counters)

    def __setstate__(self, state: tuple[Mapping[str, Any], Mapping[str, Any]]) -> None:
        """For `pickle` and `copy`, of one that was just made."""
        snapshot, counters = state
        self._policy_task.restore(snapshot)
        for name, value in counters.items():
            setattr(self, name, value)
