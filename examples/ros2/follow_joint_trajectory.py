"""Follow joint trajectories in REMOTE: a `control_msgs/action/FollowJointTrajectory` server, for ROS 2's Python.

    source /opt/ros/<distribution>/setup.bash        # with ros-<distribution>-control-msgs
    PYTHONPATH=<checkout> python3 examples/ros2/follow_joint_trajectory.py

The action is `/remote_policy_controller/follow_joint_trajectory`, on this machine only. It commands the session as any
other producer does (`Intake.remote`), with the robot's own gains. docs/ros2.md says what is judged and refused.
"""

from __future__ import annotations

import json
import math
import os
import sys
import threading
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from humanoid_sim.client import Feed, Intake, SessionError, SessionInfo
from humanoid_sim.ros2_services import MODES, find_robot, mode_name, options_of, serve

ACTION = "/remote_policy_controller/follow_joint_trajectory"
SUCCESSFUL, INVALID_GOAL, INVALID_JOINTS, PATH_TOLERANCE_VIOLATED, GOAL_TOLERANCE_VIOLATED = 0, -1, -2, -4, -5
"""Error codes of the action."""
GOAL_TOLERANCE, GOAL_TIME_TOLERANCE = 0.1, 1.0
"""rad and s, for a goal that states none; on the way, and of velocities, anything is tolerated."""
_JUMP = 0.1
"""rad that a point at 0 s may be away from where its joint is."""
_GAP = 0.1
"""s, robot's clock, without a tick after which REMOTE has let go of the joints (`stale_command_timeout_ms`)."""
_FEEDBACK_PERIOD = 0.05
"""s"""
_PRODUCER = "trajectories"
_REMOTE = MODES.index("REMOTE")


class GoalError(Exception):
    """A goal that is not followed, and why; one line."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


class Robot(NamedTuple):
    """Limits and gains of a robot; arrays of shape (n,), rad, rad/s, N·m/rad and N·m·s/rad."""

    names: Sequence[str]
    lower: Any
    upper: Any
    speed: Any
    stiffness: Any
    damping: Any


def robot_of(feed: Feed) -> Robot:
    """Return the robot of a session."""
    joints = {joint["name"]: joint for joint in json.loads(feed.document("robot"))["joints"]}
    urdf = ElementTree.fromstring(feed.document("urdf"))
    limits = {joint.get("name"): joint.find("limit") for joint in urdf.iter("joint")}
    speeds = [float(limits[name].get("velocity")) or math.inf for name in feed.joint_names]  # 0: not known

    def values(field: str, unknown: float = 0.0) -> Any:
        found = [joints[name].get(field) for name in feed.joint_names]
        return np.array([unknown if value is None else float(value) for value in found])

    lower, upper = values("lower", -math.inf), values("upper", math.inf)
    return Robot(feed.joint_names, lower, upper, np.array(speeds), values("stiffness"), values("damping"))


class Trajectory(NamedTuple):
    """Points of all joints: `times` (k,) s, the others (k, n). Lines are straight without velocities."""

    times: Any
    positions: Any
    velocities: Any
    efforts: Any

    def at(self, when: float) -> tuple[Any, Any, Any]:
        """Return positions, velocities and efforts at a time in s, each (n,); at rest before and after it."""
        last = len(self.times) - 1
        place = min(max(int(np.searchsorted(self.times, when, side="right")) - 1, 0), last - 1)
        span = self.times[place + 1] - self.times[place]
        s = min(max((when - self.times[place]) / span, 0.0), 1.0)
        begin, end = self.positions[place], self.positions[place + 1]
        effort = self.efforts[place] + s * (self.efforts[place + 1] - self.efforts[place])
        if self.velocities is None:
            position, velocity = begin + s * (end - begin), (end - begin) / span
        else:  # the cubic with these positions and velocities at its ends
            out, into = span * self.velocities[place], span * self.velocities[place + 1]
            bend, twist = 3.0 * (end - begin) - 2.0 * out - into, out + into - 2.0 * (end - begin)
            position = begin + s * (out + s * (bend + s * twist))
            velocity = (out + s * (2.0 * bend + 3.0 * s * twist)) / span
        return position, velocity if 0.0 <= when < self.times[-1] else np.zeros_like(begin), effort


def read_trajectory(message: Any, robot: Robot, start: Any) -> Trajectory:
    """Return the trajectory of a `trajectory_msgs/JointTrajectory`; joints that it does not name stay where they are.

    Args:
        message: the trajectory.
        robot: that is to follow it.
        start: where its joints are commanded now, (n,) rad.

    Raises:
        GoalError: it does not fit the robot.
    """
    names, points = list(message.joint_names), list(message.points)
    columns = _columns("joint_names", names, robot)
    if not points or not names:
        raise GoalError(INVALID_GOAL, f"has {len(points)} points of {len(names)} joints, expected one of each or more")
    times = [_seconds(point.time_from_start) for point in points]
    if times[0] < 0.0 or times[-1] <= 0.0 or min(np.diff(times), default=1.0) <= 0.0:
        raise GoalError(
            INVALID_GOAL, f"time_from_start: is {', '.join(f'{t:g}' for t in times)} s, expected to increase"
        )
    tables = {}
    for field in ("positions", "velocities", "effort"):
        rows = [list(getattr(point, field)) for point in points]
        lengths = {len(row) for row in rows}
        if lengths == {0} and field != "positions":
            continue
        if lengths != {len(names)} or not np.isfinite(rows).all():
            raise GoalError(INVALID_GOAL, f"{field}: expected {len(names)} numbers in each point, or none in any")
        tables[field] = np.array(rows, dtype=np.float64)
    positions = np.vstack([start[columns], tables["positions"]])
    knots = np.array([0.0, *times])
    if times[0] == 0.0:
        _refuse("begins", np.abs(positions[1] - positions[0]) > _JUMP, names, positions[1] - positions[0], "rad away")
        positions, knots = np.delete(positions, 1, axis=0), knots[1:]
    steps = np.diff(positions, axis=0) / np.diff(knots)[:, None]
    fastest = np.abs(np.vstack([steps, tables.get("velocities", steps)])).max(axis=0)
    lower, upper = positions[1:].min(axis=0), positions[1:].max(axis=0)
    _refuse("goes to", lower < robot.lower[columns] - 1e-6, names, lower, "rad, beyond its limit")
    _refuse("goes to", upper > robot.upper[columns] + 1e-6, names, upper, "rad, beyond its limit")
    _refuse("moves at", fastest > robot.speed[columns], names, fastest, "rad/s, faster than it can")

    def whole(rows: Any, others: Any) -> Any:
        """All joints' columns, with one row for the start where the points have none."""
        table = np.tile(np.asarray(others, dtype=np.float64), (len(knots), 1))
        table[len(knots) - len(rows) :, columns] = rows
        return table

    zeros = np.zeros(len(start))
    given, efforts = tables.get("velocities"), tables.get("effort", np.zeros((len(points), len(names))))
    keep = slice(1 if times[0] == 0.0 else 0, None)  # at 0 s the joints are where they are, at rest
    velocities = None if given is None else whole(given[keep], zeros)
    return Trajectory(knots, whole(positions, start), velocities, whole(efforts[keep], zeros))


def _columns(field: str, names: Sequence[str], robot: Robot) -> list[int]:
    unknown = [name for name in names if name not in robot.names]
    if unknown or len(set(names)) != len(names):
        problem = f"unknown joint '{unknown[0]}'" if unknown else "a joint stands there twice"
        raise GoalError(INVALID_JOINTS, f"{field}: {problem}; the robot has: {', '.join(robot.names)}")
    return [robot.names.index(name) for name in names]


def _refuse(does: str, wrong: Any, names: Sequence[str], values: Any, unit: str) -> None:
    for place in np.flatnonzero(wrong)[:1]:
        raise GoalError(INVALID_GOAL, f"{names[place]} {does} {values[place]:.3f} {unit}")


def _seconds(time: Any) -> float:
    return float(time.sec) + 1e-9 * float(time.nanosec)


class Tolerances(NamedTuple):
    """Allowed distances of joints from where they should be: (2, n) rad and rad/s on the way and at the end, and s."""

    path: Any
    goal: Any
    goal_time: float


def read_tolerances(message: Any, robot: Robot) -> Tolerances:
    """Return those of a goal. Raises `GoalError` for a joint that the robot lacks, or what is not measured."""

    def limits(field: str, position: float) -> Any:
        entries = getattr(message, field)
        table = np.tile([[position], [math.inf]], (1, len(robot.names)))
        columns = _columns(field, [entry.name for entry in entries], robot)
        for place, entry in enumerate(entries):
            if entry.acceleration > 0.0:
                raise GoalError(INVALID_GOAL, f"{field}: accelerations are not measured, expected 0 of {entry.name}")
            for row, value in enumerate((entry.position, entry.velocity)):
                if value:
                    table[row, columns[place]] = value if value > 0.0 else math.inf
        return table

    late = _seconds(message.goal_time_tolerance)
    late = late if late > 0.0 else math.inf if late < 0.0 else GOAL_TIME_TOLERANCE
    return Tolerances(limits("path_tolerance", math.inf), limits("goal_tolerance", GOAL_TOLERANCE), late)


class Goal:
    """A trajectory under way."""

    def __init__(self, trajectory: Trajectory, tolerances: Tolerances, delay: float) -> None:
        """Begin with the next tick, or `delay` s after it."""
        self.trajectory, self.tolerances, self.delay = trajectory, tolerances, delay
        self.begin: float | None = None
        """s, robot's clock."""
        self.now: tuple[float, Any, Any] | None = None
        """s since it began, and wanted and measured positions and velocities, each (2, n)."""
        self.ended = threading.Event()
        self.code, self.text = SUCCESSFUL, ""

    def end(self, code: int, text: str) -> None:
        """Say how it ended."""
        self.code, self.text = code, text
        self.ended.set()


class Stay:
    """The arms from the first goal in REMOTE on until REMOTE ends: between goals they are held."""

    def __init__(self, session: SessionInfo) -> None:
        """Attach. Raises `GoalError` outside REMOTE, or if it belongs to another program, `SessionError` as `Feed`."""
        self._lock, self._open = threading.RLock(), ExitStack()
        with ExitStack() as stack:
            self._feed = stack.enter_context(Feed(session))
            self._intake = stack.enter_context(Intake(session, _PRODUCER))
            self.robot = robot_of(self._feed)
            sample = self._feed.latest()
            if sample is None:
                raise SessionError(f"{session}: has not begun")
            tick = self._feed.decode(sample)
            problem = self._problem(tick)
            if problem:
                raise GoalError(INVALID_GOAL, problem)
            self._open = stack.pop_all()
        self.is_over = False
        self._goal: Goal | None = None
        self._time: float | None = None
        self._held = np.array(tick["joint_position"]), np.zeros(len(self.robot.names))
        """Positions and efforts that are commanded between goals."""
        self._thread = threading.Thread(target=self._run, name="trajectories", daemon=True)

    def begin(self, message: Any, delay: float = 0.0) -> Goal:
        """Follow a goal from here on, in place of the one before. Raises `GoalError` if it does not fit the robot."""
        with self._lock:
            if self.is_over:
                raise GoalError(INVALID_GOAL, "REMOTE has ended")
            if message.multi_dof_trajectory.points:
                raise GoalError(INVALID_JOINTS, "multi_dof_trajectory: has points, and the robot has no such joints")
            goal = Goal(
                read_trajectory(message.trajectory, self.robot, self._held[0]),
                read_tolerances(message, self.robot),
                delay,
            )
            self._end(INVALID_GOAL, "another goal has taken its place")
            self._goal = goal
            if self._thread.ident is None:
                self._thread.start()
            return goal

    def cancel(self, goal: Goal) -> None:
        """Hold the joints where they are commanded, unless the goal has ended already."""
        with self._lock:
            if self._goal is goal:
                self._end(SUCCESSFUL, "cancelled; the joints are held where they were commanded")

    def close(self) -> None:
        """Let the session go; REMOTE damps the joints. May be called twice."""
        with self._lock:
            self.is_over = True
            self._open.close()

    def _run(self) -> None:
        number, problem = 0, ""
        while not problem:
            try:
                sample = self._feed.wait(number, 0.5)
                if sample is not None:
                    number = sample.number
                    problem = self.step(self._feed.decode(sample))
                elif not self._feed.is_running():
                    problem = "the session has ended"
            except SessionError as error:
                problem = str(error)
        with self._lock:
            self._end(INVALID_GOAL, problem)
            self.close()

    def step(self, tick: Mapping[str, Any]) -> str:
        """Command what is due after a tick. Returns why nothing may be commanded any more; empty if all is well."""
        with self._lock:
            now = float(tick["time"])
            gap, self._time = now - (now if self._time is None else self._time), now
            problem = self._problem(tick)
            if problem:
                return problem
            if gap > _GAP:
                self._held = np.array(tick["joint_position"]), self._held[1]
                self._end(INVALID_GOAL, f"this program stood still for {gap:.2f} s, and REMOTE let go of the joints")
            position, velocity, effort = self._wanted(tick, now)
            gains = self.robot.stiffness, self.robot.damping
            self._intake.remote(self.robot.names, *(list(values) for values in (position, velocity, effort, *gains)))
            return ""

    def _problem(self, tick: Mapping[str, Any]) -> str:
        if tick["mode"] != _REMOTE:
            said = f": {tick['status_message']}" if tick["status_message"] else ""
            return f"only REMOTE follows trajectories, the mode is {mode_name(tick['mode'])}{said}"
        owner = self._feed.status().get("owners", {}).get("REMOTE", "")
        return f"REMOTE belongs to {owner}" if owner not in ("", f"{_PRODUCER} ({os.getpid()})") else ""

    def _wanted(self, tick: Mapping[str, Any], now: float) -> tuple[Any, Any, Any]:
        """Return positions, velocities and efforts to command, each (n,), and end the goal if it is time."""
        goal = self._goal
        if goal is None:
            return self._held[0], np.zeros(len(self.robot.names)), self._held[1]
        goal.begin = now + goal.delay if goal.begin is None else goal.begin
        since = now - goal.begin
        position, velocity, effort = goal.trajectory.at(since)
        measured = np.array([tick["joint_position"], tick["joint_velocity"]])
        wanted = np.array([position, velocity])
        goal.now = since, wanted, measured
        self._held = position, effort
        off, late = np.abs(measured - wanted), since - float(goal.trajectory.times[-1])
        if late < 0.0:
            if since >= 0.0 and not (off <= goal.tolerances.path).all():
                self._held = measured[0], effort  # it does not press on against what holds it
                self._end(PATH_TOLERANCE_VIOLATED, self._worst(off, goal.tolerances.path, f"{since:.2f} s on its way"))
        elif (off <= goal.tolerances.goal).all():
            worst = int(np.argmax(off[0]))
            self._end(SUCCESSFUL, f"largest error {off[0, worst]:.4f} rad, of {self.robot.names[worst]}")
        elif late > goal.tolerances.goal_time:
            self._held = measured[0], effort
            self._end(GOAL_TOLERANCE_VIOLATED, self._worst(off, goal.tolerances.goal, f"{late:.2f} s after its end"))
        if self._goal is None:
            return self._held[0], np.zeros_like(velocity), effort
        return position, velocity, effort

    def _worst(self, off: Any, limits: Any, when: str) -> str:
        row, column = np.unravel_index(int(np.argmax(~(off <= limits) * np.nan_to_num(off, nan=math.inf))), off.shape)
        unit, limit = ("rad", "rad/s")[row], limits[row, column]
        return (
            f"{self.robot.names[column]} was {off[row, column]:.3f} {unit} off {when}, tolerated are {limit:g} {unit}"
        )

    def _end(self, code: int, text: str) -> None:
        goal, self._goal = self._goal, None
        if goal is not None:
            goal.end(code, text)


class Trajectories:
    """Takes goals for whichever session is in REMOTE; any thread may call it."""

    def __init__(self, process: int | None, namespace: str = "") -> None:
        """Attach to nothing yet; arguments as of `find_robot`."""
        self._wanted = process, namespace
        self._lock = threading.Lock()
        self._stay: Stay | None = None

    def begin(self, message: Any, delay: float = 0.0) -> tuple[Stay, Goal]:
        """Follow a goal. Raises `GoalError` if it is refused, `SessionError` if there is no session."""
        with self._lock:
            stay, self._stay = self._stay, None
            if stay is None or stay.is_over:
                stay = Stay(find_robot(*self._wanted))
                try:
                    goal = stay.begin(message, delay)
                except GoalError:
                    stay.close()
                    raise
            else:
                self._stay = stay
                goal = stay.begin(message, delay)
            self._stay = stay
            return stay, goal


def advertise(node: Any, config: Namespace) -> tuple[str, Callable[[], None]]:
    """Give a node the action; returns what it is called, and what is to do at each turn: nothing."""
    from control_msgs.action import FollowJointTrajectory  # noqa: PLC0415 - a user's own, as rclpy
    from rclpy.action import ActionServer, CancelResponse  # noqa: PLC0415
    from rclpy.callback_groups import ReentrantCallbackGroup  # noqa: PLC0415

    trajectories = Trajectories(config.session, config.namespace)

    def execute(handle: Any) -> Any:
        result = FollowJointTrajectory.Result()
        stamp = _seconds(handle.request.trajectory.header.stamp)
        delay = max(stamp - 1e-9 * node.get_clock().now().nanoseconds, 0.0) if stamp else 0.0
        try:
            stay, goal = trajectories.begin(handle.request, delay)
        except (GoalError, SessionError) as error:
            handle.abort()
            result.error_code, result.error_string = getattr(error, "code", INVALID_GOAL), str(error)
            return result
        is_cancelled = False
        while not goal.ended.wait(_FEEDBACK_PERIOD) and node.context.ok():
            if handle.is_cancel_requested:
                is_cancelled = True
                stay.cancel(goal)
            elif goal.now is not None:
                handle.publish_feedback(_feedback(FollowJointTrajectory.Feedback(), stay.robot, goal.now, node))
        result.error_code, result.error_string = goal.code, goal.text
        if node.context.ok():
            (handle.canceled if is_cancelled else handle.abort if goal.code else handle.succeed)()
        return result

    name = node.get_namespace().rstrip("/") + ACTION
    ActionServer(
        node,
        FollowJointTrajectory,
        name,
        execute,
        callback_group=ReentrantCallbackGroup(),
        cancel_callback=lambda _: CancelResponse.ACCEPT,
    )
    return f"action {name}", lambda: None


def _feedback(feedback: Any, robot: Robot, now: tuple[float, Any, Any], node: Any) -> Any:
    since, wanted, measured = now
    feedback.header.stamp = node.get_clock().now().to_msg()
    feedback.joint_names = list(robot.names)
    for name, (position, velocity) in (("desired", wanted), ("actual", measured), ("error", wanted - measured)):
        point = getattr(feedback, name)
        point.positions, point.velocities = position.tolist(), velocity.tolist()
        point.time_from_start.sec = int(max(since, 0.0))
        point.time_from_start.nanosec = int(1e9 * (max(since, 0.0) % 1.0))
    return feedback


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until a signal, or the end of the session that was asked for; returns the exit status."""
    config = options_of("follow_joint_trajectory.py", __doc__ or "", arguments)
    return serve(config, "trajectories", advertise, threads=8)


if __name__ == "__main__":
    sys.exit(main())
