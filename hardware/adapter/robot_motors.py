"""All motors of a robot on its open channels, whatever their families, and the way to their being enabled."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np

from humanoid_sim.hardware.adapter.joint_tracking import find_turns, turn_problems
from humanoid_sim.hardware.adapter.wiring import AdapterSettings, Wiring
from humanoid_sim.hardware.bus.channel import OpenBus
from humanoid_sim.hardware.bus.open_channels import OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.hardware.motors import Finding, MotorFigures, MotorLink, Readings, SessionTerms
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription


class RobotMotors:
    """One link per family, each with the robot's joints that are its own; joints here are the robot's.

    There is a link for every family, also where the robot has no motor of it: it tells that family's frames from those
    of the robot's motors.
    """

    def __init__(
        self,
        settings: AdapterSettings,
        known_uids: Mapping[str, bytes],
        checks: CheckList,
        *,
        clock: Callable[[], float],
        open_bus: OpenBus,
    ) -> None:
        """Open every channel, see `OpenChannels`; `known_uids` by joint are those of an earlier activation."""
        self._wiring = wiring = settings.wiring
        bursts = tuple(wiring.period_frames(channel) for channel in range(len(settings.addresses)))
        period = settings.control_period
        self.line = OpenChannels(settings.addresses, bursts, checks, clock=clock, open_bus=open_bus, period=period)
        terms = SessionTerms(settings.host_id, settings.can_timeout, period, bursts, known_uids)
        self._joints: list[tuple[MotorLink, list[int]]] = []
        """Every link, and the joints of its motors in their order."""
        for family, driver in DRIVERS.items():
            joints = list(wiring.of_family(family))
            link = driver.link(self.line, wiring.select(joints), terms)
            self.line.listeners.append(link.receive)
            self._joints.append((link, joints))
        self.links = tuple(link for link, joints in self._joints if joints)
        """Those that have motors of the robot."""
        self._place = {joint: (link, i) for link, joints in self._joints for i, joint in enumerate(joints)}

    @property
    def uids(self) -> dict[str, bytes]:
        """Unique ids that were found, by joint."""
        return {name: uid for link in self.links for name, uid in link.uids.items()}

    @property
    def has_intruders(self) -> bool:
        """Return whether another host commands these motors."""
        return any(notes.intrusions for notes in self.line.notes)

    def readings(self) -> Readings:
        """Return the latest state of every motor, shape (n,)."""
        arrays = np.full((5, self._wiring.count), np.nan)
        for link, joints in self._joints:
            found = link.readings()
            arrays[:, joints] = found.time, found.position, found.velocity, found.effort, found.temperature
        return Readings(*arrays)

    def prepare(self, checks: CheckList) -> FloatArray:
        """Identify, stop, configure and verify; leaves the motors stopped.

        Nothing is written to any motor before every expected one has been identified and nobody else drives them.

        Returns:
            The turns of `find_turns`, shape (n,); NaN for motors that tell nothing before they are enabled.
        """
        for link in self.links:
            link.examine(checks)
        checks.refuse()
        for link in self.links:
            link.make_ready(checks)
        unknown = self._unknown_positions()
        turns = self._find_positions([i for i in range(self._wiring.count) if i not in unknown], checks)
        for i in unknown:
            checks.passed(self._wiring.names[i], "tells its position once it is enabled, not before")
        checks.refuse()
        for link in self.links:
            link.start(checks)
        self.line.check(checks)
        checks.refuse()
        return turns

    def enable(self, turns: FloatArray, checks: CheckList) -> FloatArray:
        """Enable every motor, without torque, those first that nothing stops; returns all joints' turns, shape (n,)."""
        unknown = self._unknown_positions()
        for link in sorted(self.links, key=lambda link: link.knows_positions):
            link.enable(checks)
            checks.refuse()
            if not link.knows_positions:
                turns = np.where(np.isin(np.arange(self._wiring.count), unknown), np.nan, turns)
                turns = np.where(np.isnan(turns), self._find_positions(unknown, checks), turns)
                checks.refuse()
        return turns

    def _unknown_positions(self) -> list[int]:
        """Return the joints whose motors tell nothing before they are enabled."""
        return sorted(i for i, (link, _) in self._place.items() if not link.knows_positions)

    def _find_positions(self, joints: Sequence[int], checks: CheckList) -> FloatArray:
        """Return the turns of `find_turns` for these joints, NaN for the others."""
        wiring, position = self._wiring, self.readings().position
        turns = find_turns(wiring, position)
        problems = turn_problems(wiring, position, turns)
        wrong = {joint: text for joint, text in problems if wiring.names.index(joint) in joints}
        for joint, text in wrong.items():
            checks.problem(joint, text)
        counted = {own[i]: count for link, own in self._joints for i, count in link.counted().items()}
        for i in joints:
            name, own = wiring.names[i], counted.get(i, position[i])
            if own is None:
                checks.warn(name, "mechPos cannot be read: whether it turned beyond ±4π since power-on is not known")
            elif not abs(own - position[i]) < wiring.position_range[i]:  # they differ by whole periods and the motion
                checks.problem(
                    name,
                    f"counts {own:.2f} rad by itself and reports {position[i]:.2f}: it turned beyond ±4π since "
                    "power-on; switch it off and on",
                )
            elif name not in wrong:
                joint = wiring.direction[i] * (position[i] + 2.0 * np.pi * turns[i] - wiring.offset[i])
                counts = f" ({turns[i]:+.0f} turn)" if turns[i] else ""
                degrees = round(float(np.rad2deg(joint)), 1) + 0.0
                checks.passed(name, f"at {round(joint, 3) + 0.0:.3f} rad = {degrees:.1f}°{counts}")
        return np.where(np.isin(np.arange(wiring.count), list(joints)), turns, np.nan)

    def begin(self) -> None:
        """Begin to watch: the motors are enabled, and only what happens next counts."""
        for link, _ in self._joints:
            link.begin()
        self.line.forget_events()

    def findings(self, joint: int, recent: float) -> Iterable[Finding]:
        """Return what is wrong with a joint's motor, or was since `recent`, s."""
        link, motor = self._place[joint]
        return link.findings(motor, recent)

    def count_commands(self) -> None:
        """One command goes to every motor."""
        for link in self.links:
            link.count_commands()

    def figures(self) -> list[MotorFigures]:
        """Return what happened so far, by joint."""
        return [link.figures(motor) for _, (link, motor) in sorted(self._place.items())]

    def disable(self) -> tuple[int, ...]:
        """Stop all motors and what they report by themselves; joints whose motors did not confirm it, asked twice."""
        for link in self.links:
            link.finish()
        return self.stop(self.stop(range(self._wiring.count)))

    def stop(self, joints: Iterable[int]) -> tuple[int, ...]:
        """Disable motors; those that did not confirm it."""
        wanted = set(joints)
        left: list[int] = []
        for link, own in self._joints:
            motors = [motor for motor, joint in enumerate(own) if joint in wanted]
            if motors:
                left += [own[motor] for motor in link.stop(motors)]
        return tuple(sorted(left))

    def state_text(self, joint: int) -> str:
        """Return what a joint's motor last said of its mode, in words."""
        link, motor = self._place[joint]
        return link.state_text(motor)

    def close(self) -> None:
        """Close all channels. May be called twice."""
        for link, _ in self._joints:
            link.begin()
        self.line.close()


def gain_warnings(description: RobotDescription, wiring: Wiring) -> Iterator[tuple[str, str]]:
    """Joint and what is cut off there: a controller's gain beyond its motor's range. A policy's are checked with it."""
    standby = (
        ("standby_controller_a", description.standby_controller_a),
        ("standby_controller_b", description.standby_controller_b),
    )
    passive = (
        ("damping_controller", description.mode_damping),
        ("remote_policy_controller", description.passive_damping),
    )
    stiffness = [model.stiffness for model in wiring.model]
    damping = [model.damping for model in wiring.model]
    for name, settings in standby:
        yield from _beyond(wiring, f"{name}.target_stiffness", settings.target_stiffness, stiffness)
        yield from _beyond(wiring, f"{name}.target_damping", settings.target_damping, damping)
    for name, values in passive:
        yield from _beyond(wiring, f"{name}'s damping", values.tolist(), damping)


def _beyond(wiring: Wiring, what: str, gains: Sequence[float], limits: Sequence[float]) -> Iterator[tuple[str, str]]:
    for i, (gain, limit) in enumerate(zip(gains, limits, strict=True)):
        if gain > limit:
            yield wiring.names[i], f"{what} is {gain:g}, an {wiring.model[i].name} is told {limit:g} at most"
