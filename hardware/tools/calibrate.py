"""`hardware calibrate`: homing offsets from joints swept by hand."""

from __future__ import annotations

import contextlib
import math
import os
import select
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.files import output_file
from humanoid_sim.hardware.bus.address import parse_addresses
from humanoid_sim.hardware.calibration import (
    CalibrationEntry,
    Sweep,
    SweepResult,
    Verdict,
    evaluate,
    load_calibration,
    save_calibration,
)
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.motor_link import MotorLink
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import nobody, open_bench, require_up, silence
from humanoid_sim.hardware.tools.enabled_motor import limp_motors
from humanoid_sim.hardware.tools.options import Calibrate
from humanoid_sim.hardware.tools.terminal import confirm, make_console, make_table
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.motors import FAMILIES

_ANSWER_TIME = 0.1
"""s that a poll waits for the slowest motor; as a rule all have answered within a few ms."""
_LATE = 0.1
"""s without feedback after which a position is that of then."""
_SILENT = 1.0
"""s without a position after which a motor counts as silent."""


_Position = Callable[[], float]
"""Gives a motor's position, rad, motor frame; NaN where it is silent."""


@dataclass(slots=True)
class JointTrack:
    """Positions seen of one joint."""

    angle: float = math.nan
    """rad, `direction · motor`, without an offset."""
    heard: float = -math.inf
    """s, when."""
    sweep: Sweep = field(default_factory=Sweep)
    restarts: int = 0
    """Times that the sweep began anew, because the motor was silent meanwhile."""

    def take(self, angle: float, time: float) -> None:
        """Take a position, rad, heard at `time`, s.

        A motor that was silent may have been without power, and then counts its turns anew: what was swept before says
        nothing any more.
        """
        if self.is_silent(time) and math.isfinite(self.heard):
            self.sweep = Sweep()
            self.restarts += 1
        self.angle, self.heard = angle, time
        self.sweep = self.sweep.with_angle(angle)

    def is_silent(self, time: float) -> bool:
        """Return whether nothing was heard lately."""
        return time - self.heard > _SILENT


def _poll(
    channels: RobstrideLink, wiring: Wiring, tracks: Mapping[int, JointTrack], limp: Mapping[int, _Position], now: float
) -> None:
    """Take every motor's `mechPos`, which counts turns and does not wrap, or a limp one's position; `now` in s."""
    require_up(channels)
    asked = [i for i in tracks if i not in limp]
    found = channels.poll_values(PARAMETERS["mechPos"], asked, _ANSWER_TIME) if asked else {}
    positions = {i: position() for i, position in limp.items()}
    found |= {i: position for i, position in positions.items() if math.isfinite(position)}
    for i, position in found.items():
        tracks[i].take(float(wiring.direction[i]) * position, now)


def _require_heard(channels: RobstrideLink, wiring: Wiring, tracks: Mapping[int, JointTrack]) -> None:
    """Go no further where a motor has never been heard."""
    unheard = [i for i, track in tracks.items() if track.heard == -math.inf]
    for i in unheard:
        on_channel = [k for k in tracks if wiring.channel[k] == wiring.channel[i]]
        if len(on_channel) > 1 and set(on_channel) <= set(unheard):
            raise nobody(channels, wiring.channel[i])
        raise silence(channels, i, f"{wiring.names[i]} (motor {wiring.motor_id[i]})")


@dataclass(frozen=True, slots=True)
class _Task:
    """Joints to calibrate, and how."""

    config: Calibrate
    description: RobotDescription
    wiring: Wiring
    joints: Sequence[int]

    def result(self, joint: int, sweep: Sweep) -> SweepResult:
        """Return what a sweep says of a joint."""
        config = self.config
        return evaluate(
            self.description.joints[joint],
            int(self.wiring.direction[joint]),
            sweep,
            threshold=config.threshold,
            tolerance=config.tolerance,
            any_offset=config.any_offset,
        )


_POLL_PERIOD = 0.02
"""s between two readings of all positions."""
_TABLE_PERIOD = 0.2
"""s between two pictures of the table."""


def calibrate(config: Calibrate) -> int:
    """Sweep, write the file, and return the exit status."""
    description = load_robot(config.robot)
    chosen = _chosen_joints(config, description)
    entries = dict(load_calibration(config.output, description).entries) if os.path.exists(config.output) else {}
    _check_options(config)
    addresses = parse_addresses(config.channels)
    wiring = make_wiring(description, len(addresses))
    limp = [i for i in wiring.unasked if i in chosen]
    if limp:
        names = ", ".join(wiring.names[i] for i in limp)
        print(f"{names}: say nothing before they are enabled, and are enabled without gains and current for the sweep")
        confirm("Are the joints supported?", config.yes, "not enabled")
    task = _Task(config, description, wiring, chosen)
    with open_bench(addresses, config.host_id, wiring) as channels:
        tracks = _sweep(task, channels)
    results = {i: task.result(i, tracks[i].sweep) for i in chosen}
    _report(task, results, entries)
    silent = [wiring.names[i] for i in chosen if tracks[i].restarts or tracks[i].is_silent(time.monotonic())]
    if silent:
        complain(f"warning: fell silent during the sweep, which began anew: {', '.join(silent)}")
    swept = {i: result.homing_offset for i, result in results.items() if result.homing_offset is not None}
    if swept:
        for i, offset in swept.items():
            entries[wiring.names[i]] = CalibrationEntry(wiring.motor_id[i], int(wiring.direction[i]), offset)
        order = [*description.joint_names, *entries]
        save_calibration(config.output, {name: entries[name] for name in dict.fromkeys(order) if name in entries})
        joints = "joint" if len(swept) == 1 else "joints"
        print(f"wrote {config.output}: {len(swept)} {joints} calibrated, {len(entries) - len(swept)} kept")
    else:
        print(f"{config.output}: not written, no joint was calibrated")
    missing = [name for name in description.joint_names if name not in entries]
    if missing:
        print(f"not calibrated yet: {', '.join(missing)}")
    unusable = any(result.verdict not in {Verdict.GOOD, Verdict.UNSWEPT} for result in results.values())
    return ExitStatus.FAILED if unusable or silent else 0


def _chosen_joints(config: Calibrate, description: RobotDescription) -> list[int]:
    require_known("joint", config.joints, description.joint_names, "--joints: ")
    chosen = [i for i, name in enumerate(description.joint_names) if not config.joints or name in config.joints]
    for i in chosen:
        joint = description.joints[i]
        if not (np.isfinite(joint.lower) and np.isfinite(joint.upper)):
            raise InputError(f"{description.name}: {joint.name} has no limits, so that a sweep cannot calibrate it")
    return chosen


def _check_options(config: Calibrate) -> None:
    for name, value in (("--threshold", config.threshold), ("--tolerance", config.tolerance)):
        if not value >= 0.0:
            raise InputError(f"{name}: is {value}, expected a number >= 0, in rad")
    if config.duration is not None and not config.duration > 0.0:
        raise InputError(f"--duration: is {config.duration}, expected more than 0 s")
    if config.duration is None and not sys.stdin.isatty():
        raise InputError("--duration: is needed where standard input is not a terminal; else Enter ends the sweep")
    output_file(config.output, "--output")


def _sweep(task: _Task, channels: RobstrideLink) -> Mapping[int, JointTrack]:
    """Read positions until it is enough; show them meanwhile."""
    config, wiring = task.config, task.wiring
    console = make_console()
    print(f"{task.description.name}: move each joint by hand from stop to stop; {_how_to_end(config)}")
    with contextlib.ExitStack() as shown:
        places: dict[int, _Position] = {}
        for family in FAMILIES:
            if limp := [i for i in wiring.of_family(family) if i in wiring.unasked and i in task.joints]:
                session = shown.enter_context(limp_motors(channels, limp))
                places |= {i: partial(_place, session, k) for k, i in enumerate(limp)}
        begin = next_table = time.monotonic()
        tracks = {i: JointTrack() for i in task.joints}
        live = shown.enter_context(Live(console=console, auto_refresh=False)) if console.is_terminal else None
        while True:
            now = time.monotonic()
            _poll(channels, wiring, tracks, places, now)
            if now - begin > _SILENT:
                _require_heard(channels, wiring, tracks)
            if live is not None and now >= next_table:
                next_table = max(next_table + _TABLE_PERIOD, now)
                live.update(_table(task, tracks), refresh=True)
            if _is_over(config, now - begin):
                break
            time.sleep(max(now + _POLL_PERIOD - time.monotonic(), 0.0))
        last = _table(task, tracks)
        if live is not None:
            live.update(last, refresh=True)
        else:
            console.print(last)
    return tracks


def _place(session: MotorLink, motor: int) -> float:
    """rad, motor frame; NaN once it has been silent for a while."""
    readings = session.readings()
    is_silent = time.monotonic() - readings.time[motor] > _LATE
    return math.nan if is_silent else float(readings.position[motor])


def _how_to_end(config: Calibrate) -> str:
    ends = [f"the sweep ends after {config.duration:g} s"] if config.duration is not None else []
    if sys.stdin.isatty():
        ends.append("Enter writes the file, Ctrl-C leaves it alone")
    return "; ".join(ends)


def _is_over(config: Calibrate, elapsed: float) -> bool:
    if config.duration is not None and elapsed >= config.duration:
        return True
    if sys.stdin.isatty() and select.select([sys.stdin], [], [], 0.0)[0]:
        sys.stdin.readline()
        return True
    return False


_COLOURS = {
    Verdict.GOOD: "green",
    Verdict.UNSWEPT: "dim",
    Verdict.INCOMPLETE: "yellow",
    Verdict.BEYOND: "yellow",
    Verdict.FLIPPED: "red",
}


def _table(task: _Task, tracks: Mapping[int, JointTrack]) -> Table:
    headings = ("id", "now", "low", "high", "swept", "range", "offset")
    table = make_table("joint", *headings, "", right=headings)
    for i, track in tracks.items():
        result, joint = task.result(i, track.sweep), task.description.joints[i]
        numbers = (track.angle, track.sweep.lowest, track.sweep.highest, track.sweep.width, joint.upper - joint.lower)
        offset = "" if result.homing_offset is None else f"{result.homing_offset:.3f}"
        verdict = f"[{_COLOURS[result.verdict]}]{result.verdict.value}[/]"
        if track.restarts and result.verdict is not Verdict.GOOD:
            verdict = "[red]was silent: sweep again[/]"
        if track.is_silent(time.monotonic()):
            verdict = "[red]silent[/]"
        shown = (f"{number:.2f}" if math.isfinite(number) else "-" for number in numbers)
        table.add_row(escape(joint.name), str(task.wiring.motor_id[i]), *shown, offset, verdict)
    return table


_WHY_NOT = {
    Verdict.INCOMPLETE: "swept {width:.2f} rad of a range of {range:.2f}: not used. Reach both stops, or raise "
    "--tolerance",
    Verdict.BEYOND: "swept {width:.2f} rad, more than its range of {range:.2f}: not used. Its stops are not its limits "
    "(raise --tolerance), or another motor has the id {motor_id} (discover)",
    Verdict.FLIPPED: "swept outside its limits of {joint.lower:g} to {joint.upper:g} rad: not used. Its direction, "
    "{direction:+g} in the robot description, is flipped, or its motor's zero was never set (--any-offset)",
}


def _report(task: _Task, results: Mapping[int, SweepResult], entries: Mapping[str, CalibrationEntry]) -> None:
    """Say what changes, and why what was swept is not used."""
    for i, result in results.items():
        joint = task.description.joints[i]
        before = entries.get(joint.name)
        if result.homing_offset is not None and before is not None:
            print(f"{joint.name}: {before.homing_offset:.4f} -> {result.homing_offset:.4f} rad")
        if result.verdict in _WHY_NOT:
            why_not = _WHY_NOT[result.verdict].format(
                joint=joint,
                width=result.width,
                range=joint.upper - joint.lower,
                motor_id=task.wiring.motor_id[i],
                direction=task.wiring.direction[i],
            )
            complain(f"warning: {joint.name}: {why_not}")
