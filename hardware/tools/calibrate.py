"""`hardware calibrate`: homing offsets from joints swept by hand."""

from __future__ import annotations

import contextlib
import math
import select
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

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
    Verdict,
    evaluate,
    read_entries,
    save_calibration,
)
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.motor_link import LinkTerms, MotorLink
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import (
    confirm,
    enabled,
    make_console,
    make_table,
    open_bench,
    require_up,
    silence,
)
from humanoid_sim.hardware.tools.options import Calibrate
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import RobotDescription

_ANSWER_TIME = 0.1  # s that a poll waits for the slowest motor; as a rule all have answered within a few ms
_LATE = 0.1  # s without feedback after which a limp motor's position counts as old
_SILENT = 1.0  # s without a position after which a motor counts as silent
_POLL_PERIOD = 0.02  # s between two readings of all positions
_TABLE_PERIOD = 0.2  # s between two pictures of the table
_FEEDBACK_PERIOD = 0.02  # s between two frames of a limp motor's feedback


@dataclass(slots=True)
class JointTrack:
    """Positions of one joint."""

    angle: float = math.nan
    """rad, `direction · motor`, without an offset."""
    received: float = -math.inf
    """s, when."""
    sweep: Sweep = field(default_factory=Sweep)
    restarts: int = 0
    """Times that the sweep began anew, because the motor was silent and may have been without power."""

    def add(self, angle: float, time: float) -> None:
        """Add a position, rad, received at `time`, s."""
        if self.is_silent(time) and math.isfinite(self.received):
            self.sweep = Sweep()  # switched on again, it counts its turns anew
            self.restarts += 1
        self.angle, self.received = angle, time
        self.sweep = self.sweep.with_angle(angle)

    def is_silent(self, time: float) -> bool:
        """Return whether nothing was received lately."""
        return time - self.received > _SILENT


def calibrate(config: Calibrate) -> int:
    """Sweep, write the file, and return the exit status."""
    description = load_robot(config.robot)
    chosen = _chosen(config, description)
    entries = dict(read_entries(config.output, description))
    _check_options(config)
    addresses = parse_addresses(config.channels)
    wiring = make_wiring(description, len(addresses))
    if limp := [wiring.names[i] for i in chosen if i in wiring.unasked]:
        print(f"{', '.join(limp)}: report nothing before they are enabled, and are enabled limp for the sweep")
        confirm("Are the joints supported?", config.yes, "not enabled")
    with open_bench(addresses, config.host_id, wiring) as link:
        tracks = _sweep(config, description, wiring, link, chosen)
    failures = [i for i in chosen if tracks[i].restarts or tracks[i].is_silent(time.monotonic())]
    if failures:
        complain(f"warning: fell silent during the sweep: {', '.join(wiring.names[i] for i in failures)}")
    swept = 0
    for i in chosen:
        joint, direction = description.joints[i], int(wiring.direction[i])
        verdict, offset = _verdict(config, description, wiring, i, tracks[i].sweep)
        old = entries.get(joint.name)
        if offset is not None:
            is_same = old is not None and (old.id, old.direction) == (wiring.motor_id[i], direction)
            confirmed = old is not None and is_same and old.direction_confirmed
            entries[joint.name] = CalibrationEntry(wiring.motor_id[i], direction, offset, confirmed)
            swept += 1
            if old is not None and old.homing_offset is not None:
                print(f"{joint.name}: {old.homing_offset:.4f} -> {offset:.4f} rad")
        elif verdict is not Verdict.UNSWEPT:
            failures.append(i)
            bounds = f"{joint.lower:g} to {joint.upper:g} rad"
            text = _WHY_NOT[verdict].format(width=tracks[i].sweep.width, bounds=bounds, direction=direction)
            complain(f"warning: {joint.name}: {text}: not used")
    if swept:
        save_calibration(config.output, entries, description.joint_names)
        print(f"wrote {config.output}: {swept} joint{'s' * (swept > 1)} calibrated, {len(entries) - swept} kept")
    else:
        print(f"{config.output}: not written, no joint was calibrated")
    missing = [name for name in description.joint_names if name not in entries or entries[name].homing_offset is None]
    if missing:
        print(f"not calibrated yet: {', '.join(missing)}")
    return ExitStatus.FAILED if failures else 0


_WHY_NOT = {
    Verdict.INCOMPLETE: "swept {width:.2f} rad of {bounds}; reach both stops, or raise --tolerance",
    Verdict.BEYOND: "swept {width:.2f} rad, more than {bounds}; its stops are not its limits (--tolerance), or another "
    "motor has its id (discover)",
    Verdict.FLIPPED: "swept outside its limits of {bounds}; its direction, {direction:+d} in the robot description, is "
    "wrong, or its motor's zero was never set (--any-offset)",
}


def _chosen(config: Calibrate, description: RobotDescription) -> list[int]:
    require_known("joint", config.joints, description.joint_names, "--joints: ")
    chosen = [i for i, name in enumerate(description.joint_names) if not config.joints or name in config.joints]
    for i in chosen:
        if not np.isfinite([description.lower[i], description.upper[i]]).all():
            raise InputError(f"{description.name}: {description.joint_names[i]} has no limits to be swept between")
    return chosen


def _check_options(config: Calibrate) -> None:
    if not config.tolerance >= 0.0:
        raise InputError(f"--tolerance: is {config.tolerance}, expected a number >= 0, in rad")
    if config.duration is not None and not config.duration > 0.0:
        raise InputError(f"--duration: is {config.duration}, expected more than 0 s")
    if config.duration is None and not sys.stdin.isatty():
        raise InputError("--duration: is needed where standard input is not a terminal; else Enter ends the sweep")
    output_file(config.output, "--output")


def _verdict(
    config: Calibrate, description: RobotDescription, wiring: Wiring, joint: int, sweep: Sweep
) -> tuple[Verdict, float | None]:
    one, direction = description.joints[joint], int(wiring.direction[joint])
    return evaluate(one, direction, sweep, tolerance=config.tolerance, any_offset=config.any_offset)


def _sweep(
    config: Calibrate, description: RobotDescription, wiring: Wiring, link: RobstrideLink, chosen: list[int]
) -> Mapping[int, JointTrack]:
    """Read positions until it is enough; show them meanwhile."""
    console, tracks = make_console(), {i: JointTrack() for i in chosen}
    enter = "; Enter writes the file, Ctrl-C leaves it alone" if sys.stdin.isatty() else ""
    lasts = "" if config.duration is None else f"; the sweep ends after {config.duration:g} s"
    print(f"{description.name}: move each joint by hand from stop to stop{lasts}{enter}")
    unasked = [i for i in chosen if i in wiring.unasked]
    with contextlib.ExitStack() as stack:
        limp = None
        if unasked:
            terms = LinkTerms(config.host_id, 0.0, _FEEDBACK_PERIOD, np.zeros(len(unasked)), is_whole=False)
            limp = stack.enter_context(enabled(link, wiring.select(unasked), terms))
        begin = next_table = time.monotonic()
        live = stack.enter_context(Live(console=console, auto_refresh=False)) if console.is_terminal else None
        while True:
            now = time.monotonic()
            _poll(link, wiring, tracks, unasked, limp, now)
            if now - begin > _SILENT:
                _require_all(link, wiring, tracks)
            if live is not None and now >= next_table:
                next_table = now + _TABLE_PERIOD
                live.update(_table(config, description, wiring, tracks), refresh=True)
            if _is_over(config, now - begin):
                break
            time.sleep(max(now + _POLL_PERIOD - time.monotonic(), 0.0))
        if live is None:
            console.print(_table(config, description, wiring, tracks))
    return tracks


def _is_over(config: Calibrate, elapsed: float) -> bool:
    if config.duration is not None and elapsed >= config.duration:
        return True
    if sys.stdin.isatty() and select.select([sys.stdin], [], [], 0.0)[0]:
        sys.stdin.readline()
        return True
    return False


def _poll(
    link: RobstrideLink,
    wiring: Wiring,
    tracks: Mapping[int, JointTrack],
    unasked: list[int],
    limp: MotorLink | None,
    now: float,
) -> None:
    """Add every motor's `mechPos`, which counts turns and does not wrap, or the position that a limp one reports."""
    require_up(link)
    found = link.poll_values(PARAMETERS["mechPos"], [i for i in tracks if i not in unasked], _ANSWER_TIME)
    if limp is not None:
        readings = limp.readings()
        fresh = link.line.clock() - readings.time <= _LATE
        found |= {i: float(readings.position[k]) for k, i in enumerate(unasked) if fresh[k]}
    for i, position in found.items():
        tracks[i].add(float(wiring.direction[i]) * position, now)


def _require_all(link: RobstrideLink, wiring: Wiring, tracks: Mapping[int, JointTrack]) -> None:
    """Raise `SilentMotorError` if a motor has never been received."""
    for i, track in tracks.items():
        if track.received == -math.inf:
            raise silence(link, wiring.channel[i], f"{wiring.names[i]} (motor {wiring.motor_id[i]}) does not answer")


_COLOURS = {
    Verdict.GOOD: "green",
    Verdict.UNSWEPT: "dim",
    Verdict.INCOMPLETE: "yellow",
    Verdict.BEYOND: "yellow",
    Verdict.FLIPPED: "red",
}


def _table(config: Calibrate, description: RobotDescription, wiring: Wiring, tracks: Mapping[int, JointTrack]) -> Table:
    headings = ("id", "now", "low", "high", "swept", "range", "offset")
    table = make_table("joint", *headings, "", right=headings)
    for i, track in tracks.items():
        verdict, offset = _verdict(config, description, wiring, i, track.sweep)
        width = description.upper[i] - description.lower[i]
        numbers = (track.angle, track.sweep.lowest, track.sweep.highest, track.sweep.width, width)
        text = f"[{_COLOURS[verdict]}]{verdict.value}[/]"
        if track.is_silent(time.monotonic()):
            text = "[red]silent[/]"
        elif track.restarts and verdict is not Verdict.GOOD:
            text = "[red]was silent: sweep again[/]"
        shown = (f"{number:.2f}" if math.isfinite(number) else "-" for number in numbers)
        name, written = escape(wiring.names[i]), "" if offset is None else f"{offset:.3f}"
        table.add_row(name, str(wiring.motor_id[i]), *shown, written, text)
    return table
