"""Commands for REMOTE between LeRobot's actions, which come at a rate of their own."""

import threading
import time

import numpy as np

from humanoid_sim.client import Intake, SessionError, SessionInfo, monotonic_ns
from humanoid_sim.robots.description import RobotDescription

_PERIOD = 0.01  # s between two commands, at least; the session's period where that is longer
_SLOWEST = 0.25  # s between two actions; more is a pause


class Trajectory:
    """Joint positions over time: a straight line from each action to the next.

    An action is reached when the next one is due, as far as the last two tell. After a pause there is nothing to come
    from, so the difference between the robot's command and the action shrinks at `approach_speed`, rad/s.
    """

    def __init__(self, approach_speed: float, stale_after: float) -> None:
        self._speed, self._stale_after = approach_speed, stale_after
        self._period = 0.0
        self._time = self._begin = -np.inf
        self._start = self._goal = self._offset = np.empty(0)

    def add(self, action: np.ndarray, commanded: np.ndarray, now: float) -> None:
        """Add an action that arrived now, s; `commanded` is what the robot is commanded at present, rad."""
        is_pause = now > self._time + self._period + self._stale_after
        start = action if is_pause else self._between(now)
        if is_pause:
            self._offset, self._begin = commanded - action, now
        if now - self._time <= _SLOWEST:
            self._period = now - self._time
        self._start, self._goal, self._time = start, action, now

    def position(self, now: float) -> np.ndarray:
        """Return what to command, rad."""
        distance = np.abs(self._offset).max()
        left = max(1.0 - (now - self._begin) * self._speed / distance, 0.0) if distance else 0.0
        return self._between(now) + left * self._offset

    def age(self, now: float) -> float:
        """Return the time since the newest action was due to be reached, s: it is executed until then."""
        return max(now - self._time - self._period, 0.0)

    def _between(self, now: float) -> np.ndarray:
        share = min((now - self._time) / self._period, 1.0) if self._period else 1.0
        return self._start + share * (self._goal - self._start)


class Sender:
    """A thread that commands a session, as old as LeRobot's newest action: silence ends in the passive hold."""

    def __init__(
        self, session: SessionInfo, description: RobotDescription, control_period: float, approach_speed: float
    ) -> None:
        self._session, self._description, self._period = session, description, max(_PERIOD, control_period)
        self._stale_after = 1e-3 * description.remote_policy_controller.stale_command_timeout_ms
        self._trajectory = Trajectory(approach_speed, self._stale_after)
        self._held: np.ndarray | None = None
        self._has_action = False
        self._lock, self._stopped = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="humanoid_sim sender", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Send no more."""
        self._stopped.set()
        self._thread.join()

    def hold(self, position: np.ndarray) -> None:
        """Send a pose, rad, until the first action comes."""
        with self._lock:
            self._held = position

    def add(self, action: np.ndarray, commanded: np.ndarray) -> None:
        """Send an action, rad; `commanded` as for `Trajectory.add`."""
        with self._lock:
            self._trajectory.add(action, commanded, time.monotonic())
            self._has_action = True

    def _run(self) -> None:
        try:
            with Intake(self._session, "lerobot") as intake:
                while not self._stopped.wait(self._period):
                    self._send(intake)
        except SessionError:  # it has ended, which LeRobot's next observation says
            return

    def _send(self, intake: Intake) -> None:
        with self._lock:
            now, stamp = time.monotonic(), monotonic_ns()
            position = self._trajectory.position(now) if self._has_action else self._held
            age = self._trajectory.age(now) if self._has_action else 0.0
        if position is not None and age < self._stale_after:  # a stale one would be refused
            robot, zeros = self._description, [0.0] * len(position)
            gains = robot.stiffness.tolist(), robot.damping.tolist()
            stamp -= round(1e9 * age)
            intake.remote(robot.joint_names, position.tolist(), zeros, zeros, *gains, stamp=stamp)
