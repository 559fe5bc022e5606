"""`hardware calibrate`: homing offsets from joints swept by hand."""

from __future__ import annotations

import contextlib
import select
import sys
import time
from collections.abc import Mapping

import numpy as np
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.files import output_file
from humanoid_sim.hardware.calibration import CalibrationEntry, Sweep, Verdict, evaluate, read_entries, save_calibration
from humanoid_sim.hardware.can_bus import parse_addresses
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.motor_link import LinkTerms
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools import bench
from humanoid_sim.hardware.tools.options import Calibrate
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import RobotDescription

_ANSWER_TIME = 0.1  # s that a poll waits for the slowest motor; as a rule all have answered within a few ms
_LATE = 0.1  # s without feedback after which a limp motor's position counts as old
_SILENT = 1.0  # s without a position after which a motor counts as silent
_PERIOD = 0.04  # s between two readings of all positions, and between two frames of a limp motor's feedback
_WHY_NOT = {
    Verdict.INCOMPLETE: "less than its range: reach both stops, or raise --tolerance",
    Verdict.BEYOND: "more than its range: its stops are not its limits (--tolerance), or another motor has its id",
    Verdict.FLIPPED: "outside its limits: its direction in the robot file is wrong, or its zero not set (--any-offset)",
}


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
        bench.confirm("Are the joints supported?", config.yes, "not enabled")
    with bench.open_bench(addresses, wiring) as link:
        sweeps = _sweep(config, description, wiring, link, chosen)
    failed, swept = False, 0
    for i, sweep in sweeps.items():
        name, number, direction = wiring.names[i], wiring.motor_id[i], int(wiring.direction[i])
        verdict, offset = _evaluate(config, description, direction, i, sweep)
        old = entries.get(name)
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
            complain(f"warning: {name}: not used: swept {sweep.width:.2f} rad of {bounds}: {_WHY_NOT[verdict]}")
    if swept:
        save_calibration(config.output, entries, wiring.names)
        print(f"wrote {config.output}: {swept} joint{'s' * (swept > 1)} calibrated, {len(entries) - swept} kept")
    else:
        print(f"{config.output}: not written, no joint was calibrated")
    return ExitStatus.of(not failed)


def _evaluate(
    config: Calibrate, description: RobotDescription, direction: int, joint: int, sweep: Sweep
) -> tuple[Verdict, float | None]:
    one = description.joints[joint]
    return evaluate(one, direction, sweep, tolerance=config.tolerance, any_offset=config.any_offset)


def _sweep(
    config: Calibrate, description: RobotDescription, wiring: Wiring, link: RobstrideLink, chosen: list[int]
) -> dict[int, Sweep]:
    """Read positions until it is enough; show them meanwhile. A motor that falls silent may lose its count of turns."""
    console, sweeps = bench.make_console(), {i: Sweep() for i in chosen}
    print(
        f"{description.name}: move each joint by hand from stop to stop; Enter writes the file, Ctrl-C leaves it alone"
    )
    unasked = [i for i in chosen if i in wiring.unasked]
    with contextlib.ExitStack() as stack:
        limp = None
        if unasked:
            terms = LinkTerms(0.0, _PERIOD, np.zeros(len(unasked)))
            limp = stack.enter_context(bench.enabled(link, wiring.select(unasked), terms))
        live = stack.enter_context(Live(console=console, auto_refresh=False)) if console.is_terminal else None
        begin = time.monotonic()
        received = dict.fromkeys(chosen, begin)
        while not _is_over(config, time.monotonic() - begin):
            bench.check_channels(link)
            asked = dict.fromkeys([i for i in chosen if i not in unasked], PARAMETERS["mechPos"])
            answers = link.read(asked, (_ANSWER_TIME,), takes_late=True)
            found = {i: value for i, value in answers.items() if value is not None}
            if limp is not None:
                readings = limp.readings()
                fresh = link.line.clock() - readings.time <= _LATE
                found |= {i: float(readings.position[k]) for k, i in enumerate(unasked) if fresh[k]}
            now = time.monotonic()
            for i in chosen:
                if i in found:
                    received[i] = now
                    sweeps[i] = sweeps[i].with_angle(float(wiring.direction[i]) * found[i])
                elif now - received[i] > _SILENT:
                    raise bench.silence(
                        link, wiring.channel[i], f"{wiring.names[i]} ({wiring.motor_id[i]}) does not answer"
                    )
            if live is not None:
                live.update(_table(config, description, wiring, sweeps), refresh=True)
            time.sleep(_PERIOD)
        if live is None:
            console.print(_table(config, description, wiring, sweeps))
    return sweeps


def _is_over(config: Calibrate, elapsed: float) -> bool:
    if config.duration is not None and elapsed >= config.duration:
        return True
    if sys.stdin.isatty() and select.select([sys.stdin], [], [], 0.0)[0]:
        sys.stdin.readline()
        return True
    return False


def _table(config: Calibrate, description: RobotDescription, wiring: Wiring, sweeps: Mapping[int, Sweep]) -> Table:
    rows = []
    for i, sweep in sweeps.items():
        verdict, offset = _evaluate(config, description, int(wiring.direction[i]), i, sweep)
        numbers = (sweep.lowest, sweep.highest, sweep.width, wiring.upper[i] - wiring.lower[i])
        figures = [f"{number:.2f}" for number in numbers]
        written = "" if offset is None else f"{offset:.3f}"
        rows.append([escape(wiring.names[i]), str(wiring.motor_id[i]), *figures, written, verdict.value])
    return bench.make_table(("joint", "id", "low", "high", "swept", "range", "offset", ""), rows)
