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
    check_channels,
    confirm,
    enabled,
    make_console,
    make_table,
    open_bench,
    silence,
)
from humanoid_sim.hardware.tools.options import Calibrate
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import RobotDescription

_ANSWER_TIME = 0.1  # s that a poll waits for the slowest motor; as a rule all have answered within a few ms
_LATE = 0.1  # s without feedback after which a limp motor's position counts as old
_SILENT = 1.0  # s without a position after which a motor counts as silent
_PERIOD = 0.02  # s between two readings of all positions, and between two frames of a limp motor's feedback
_TABLE_PERIOD = 0.2  # s between two pictures of the table
_WHY_NOT = {
    Verdict.INCOMPLETE: "less than its range: reach both stops, or raise --tolerance",
    Verdict.BEYOND: "more than its range: its stops are not its limits (--tolerance), or another motor has its id",
    Verdict.FLIPPED: "outside its limits: its direction in the robot file is wrong, or its zero not set (--any-offset)",
}


@dataclass(slots=True)
class JointTrack:
    """Positions of one joint."""

    angle: float = math.nan  # rad, `direction · motor`, without an offset
    received: float = -math.inf  # s, time of the latest one
    sweep: Sweep = field(default_factory=Sweep)
    restarts: int = 0  # times that the motor fell silent: it may have been without power, so its sweep begins anew

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
    description, addresses = load_robot(config.robot), parse_addresses(config.channels)
    wiring = make_wiring(description, len(addresses))
    require_known("joint", config.joints, wiring.names, "--joints: ")
    chosen = [i for i, name in enumerate(wiring.names) if not config.joints or name in config.joints]
    if unlimited := [wiring.names[i] for i in chosen if not np.isfinite(wiring.upper[i] - wiring.lower[i])]:
        raise InputError(f"{description.name}: no limits to be swept between: {', '.join(unlimited)}")
    if not config.tolerance > 0.0 or (config.duration is not None and not config.duration > 0.0):
        raise InputError("--tolerance, --duration: expected numbers above 0")
    if config.duration is None and not sys.stdin.isatty():
        raise InputError("--duration: is needed where standard input is not a terminal; else Enter ends the sweep")
    entries = dict(read_entries(config.output, description))
    output_file(config.output, "--output")
    if limp := [wiring.names[i] for i in chosen if i in wiring.unasked]:
        print(f"{', '.join(limp)}: report nothing before they are enabled, and are enabled limp for the sweep")
        confirm("Are the joints supported?", config.yes, "not enabled")
    with open_bench(addresses, wiring) as link:
        tracks = _sweep(config, description, wiring, link, chosen)
    failed, swept = False, 0
    for i, track in tracks.items():
        name, number, direction = wiring.names[i], wiring.motor_id[i], int(wiring.direction[i])
        verdict, offset = _evaluate(config, description, direction, i, track)
        old = entries.get(name)
        if track.restarts:
            failed = True
            complain(f"warning: {name}: fell silent during the sweep")
        if offset is not None:
            swept += 1
            is_confirmed = (
                old is not None and old.direction_confirmed and (old.id, old.direction) == (number, direction)
            )
            entries[name] = CalibrationEntry(number, direction, offset, is_confirmed)
            before = "" if old is None or old.homing_offset is None else f"{old.homing_offset:.4f} -> "
            print(f"{name}: {before}{offset:.4f} rad")
        elif verdict in _WHY_NOT:
            failed = True
            bounds = f"{wiring.lower[i]:g} to {wiring.upper[i]:g} rad"
            complain(f"warning: {name}: not used: swept {track.sweep.width:.2f} rad of {bounds}: {_WHY_NOT[verdict]}")
    if swept:
        save_calibration(config.output, entries, wiring.names)
        print(f"wrote {config.output}: {swept} joint{'s' * (swept > 1)} calibrated, {len(entries) - swept} kept")
    else:
        print(f"{config.output}: not written, no joint was calibrated")
    return ExitStatus.of(not failed)


def _evaluate(
    config: Calibrate, description: RobotDescription, direction: int, joint: int, track: JointTrack
) -> tuple[Verdict, float | None]:
    one = description.joints[joint]
    return evaluate(one, direction, track.sweep, tolerance=config.tolerance, any_offset=config.any_offset)


def _sweep(
    config: Calibrate, description: RobotDescription, wiring: Wiring, link: RobstrideLink, chosen: list[int]
) -> Mapping[int, JointTrack]:
    """Read positions until it is enough; show them meanwhile."""
    console, tracks = make_console(), {i: JointTrack() for i in chosen}
    print(
        f"{description.name}: move each joint by hand from stop to stop; Enter writes the file, Ctrl-C leaves it alone"
    )
    unasked = [i for i in chosen if i in wiring.unasked]
    with contextlib.ExitStack() as stack:
        limp = None
        if unasked:
            terms = LinkTerms(0.0, _PERIOD, np.zeros(len(unasked)))
            limp = stack.enter_context(enabled(link, wiring.select(unasked), terms))
        begin = next_table = time.monotonic()
        live = stack.enter_context(Live(console=console, auto_refresh=False)) if console.is_terminal else None
        while not _is_over(config, time.monotonic() - begin):
            check_channels(link)
            now = time.monotonic()
            for i, position in _positions(link, [i for i in chosen if i not in unasked], limp, unasked).items():
                tracks[i].add(float(wiring.direction[i]) * position, now)
            for i, track in tracks.items():
                if track.received == -math.inf and now - begin > _SILENT:
                    raise silence(link, wiring.channel[i], f"{wiring.names[i]} ({wiring.motor_id[i]}) does not answer")
            if live is not None and now >= next_table:
                next_table = now + _TABLE_PERIOD
                live.update(_table(config, description, wiring, tracks), refresh=True)
            time.sleep(max(now + _PERIOD - time.monotonic(), 0.0))
        for track in tracks.values():
            track.restarts += track.is_silent(time.monotonic())
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


def _positions(link: RobstrideLink, asked: list[int], limp: MotorLink | None, unasked: list[int]) -> dict[int, float]:
    """Return every motor's `mechPos`, which counts turns and does not wrap, or the position that a limp one reports."""
    found = link.poll_values(PARAMETERS["mechPos"], asked, _ANSWER_TIME)
    if limp is not None:
        readings = limp.readings()
        fresh = link.line.clock() - readings.time <= _LATE
        found |= {i: float(readings.position[k]) for k, i in enumerate(unasked) if fresh[k]}
    return found


def _table(config: Calibrate, description: RobotDescription, wiring: Wiring, tracks: Mapping[int, JointTrack]) -> Table:
    rows = []
    for i, track in tracks.items():
        verdict, offset = _evaluate(config, description, int(wiring.direction[i]), i, track)
        sweep = track.sweep
        numbers = (track.angle, sweep.lowest, sweep.highest, sweep.width, wiring.upper[i] - wiring.lower[i])
        written = "" if offset is None else f"{offset:.3f}"
        word = "silent" if track.is_silent(time.monotonic()) else verdict.value
        figures = [f"{number:.2f}" for number in numbers]
        rows.append([escape(wiring.names[i]), str(wiring.motor_id[i]), *figures, written, word])
    return make_table(("joint", "id", "now", "low", "high", "swept", "range", "offset", ""), rows)
