"""The simulated robot as a `dm_control` physics: the same model and data, seen by its viewer and by its cameras."""

from __future__ import annotations

from collections.abc import Callable

from dm_control import mujoco
from dm_control.mujoco import wrapper

from humanoid_sim.simulation.mujoco_robot import MujocoRobot

__all__ = ["RobotPhysics"]


class RobotPhysics(mujoco.Physics):
    """A robot's simulation, which its own code steps: a policy's command, held for one policy step.

    A simulation that is no longer sound is a fault that ends the episode, not a `PhysicsError`.
    """

    def __init__(self, robot: MujocoRobot, advance: Callable[[], None]) -> None:
        """Share the robot's model and data.

        Args:
            robot: the robot.
            advance: takes one policy step with the action that the task was given.
        """
        super().__init__(wrapper.MjData(robot.data))
        self._advance = advance

    def step(self, nstep: int = 1) -> None:
        """One policy step, which is `nstep` physics steps."""
        del nstep
        self._advance()

    def after_reset(self) -> None:
        """Bring what derives from the start up to date for pictures, and keep where the solver begins."""
        accelerations = self.data.qacc.copy(), self.data.qacc_warmstart.copy()
        super().after_reset()
        self.data.qacc[:], self.data.qacc_warmstart[:] = accelerations

    def copy(self, share_model: bool = False) -> mujoco.Physics:
        """The present state as a physics of its own, which nothing commands."""
        return mujoco.Physics(self.data._make_copy(share_model=share_model))
