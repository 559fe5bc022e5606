"""`hardware calibrate`: homing offsets from joints swept by hand."""

from __future__ import annotations

import contextlib
import select
import sys
import time
from collections.abc import Callable, Mapping

import numpy as np
from rich.live import Live
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

_ANSWER_TIME = 0.1  # s that a poll waits for the slowest motor; as a rule all have answered within a few ms
_LATE = 0.1  # s without feedback after which a limp motor's position counts as old
_SILENT = 1.0  # s without a position after which a motor counts as silent
_PERIOD = 0.04  # s between two readings of all positions, and between two frames of a limp motor's feedback
_WHY_NOT = {
    Verdict.INCOMPLETE: "swept less than its range: reach both stops, or raise --tolerance",
    Verdict.BEYOND: "swept more than its range: its stops are not its limits, or another motor has its id",
    Verdict.FLIPPED: "outside its limits: its direction in the robot file is wrong, or its zero not set (--any-offset)",
}
_Judge = Callable[[int, Sweep], tuple[Verdict, float | None]]


def calibrate(config: Calibrate) -> int:
    """Sweep, write the file, and return the exit status."""
    description, addresses = load_robot(config.robot), parse_addresses(config.channels)
    wiring = make_wiring(description, len(addresses))
    require_known("joint", config.joints, wiring.names, "--joints: ")
    chosen = [i for i, name in enumerate(wiring.names) if not config.joints or name in config.joints]
    if unlimited := [wiring.names[i] for i in chosen if not np.isfinite(wiring.upper[i] - wiring.lower[i])]:
        raise InputError(f"{description.name}: no limits to be swept between: {', '.join(unlimited)}")
    if not sys.stdin.isatty():
        raise InputError("calibrate: standard input is not a terminal, on which Enter ends the sweep")
    entries = dict(read_entries(config.output, description))
    output_file(config.output, "--output")
    if limp := [wiring.names[i] for i in chosen if i in wiring.unasked]:
        print(f"{', '.join(limp)}: report nothing before they are enabled, and are enabled limp for the sweep")
        bench.confirm("Are the joints supported?", False, "not enabled")

    def judge(i: int, sweep: Sweep) -> tuple[Verdict, float | None]:
        joint, direction = description.joints[i], int(wiring.direction[i])
        return evaluate(joint, direction, sweep, tolerance=config.tolerance, any_offset=config.any_offset)

    print("move each joint by hand from stop to stop; Enter writes the file, Ctrl-C leaves it alone")
    with bench.open_bench(addresses, wiring.motors) as link:
        sweeps = _sweep(wiring, link, chosen, judge)
    failed, swept = False, 0
    for i, sweep in sweeps.items():
        name, motor, (verdict, offset) = wiring.names[i], description.joints[i].motor, judge(i, sweep)
        if offset is not None and motor is not None:
            swept += 1
            old = entries.get(name, CalibrationEntry(motor.can_id, motor.direction))
            is_confirmed = old.direction_confirmed and (old.id, old.direction) == (motor.can_id, motor.direction)
            entries[name] = CalibrationEntry(motor.can_id, motor.direction, offset, is_confirmed)
        elif verdict in _WHY_NOT:
            failed = True
            complain(f"warning: {name}: not used: {_WHY_NOT[verdict]}")
    if swept:
        save_calibration(config.output, entries, wiring.names)
        print(f"wrote {config.output}: {swept} joint{'s' * (swept > 1)} calibrated, {len(entries) - swept} kept")
    else:
        print(f"{config.output}: not written, no joint was calibrated")
    return ExitStatus.of(not failed)


def _sweep(wiring: Wiring, link: RobstrideLink, chosen: list[int], judge: _Judge) -> dict[int, Sweep]:
    """Read positions until it is enough; show them meanwhile. A motor that falls silent may lose its count of turns."""
    sweeps: dict[int, Sweep] = dict.fromkeys(chosen, (np.nan, np.nan))
    unasked = [i for i in chosen if i in wiring.unasked]
    asked = [i for i in chosen if i not in unasked]
    motors = [wiring.motors[i]._replace(damping=0.0) for i in unasked]
    limp_motors = bench.limp_motors(link, motors, LinkTerms(0.0, _PERIOD)) if motors else contextlib.nullcontext()
    with limp_motors as limp, Live(console=bench.make_console(), auto_refresh=False) as live:
        received = dict.fromkeys(chosen, time.monotonic())
        while not _is_over():
            bench.check_channels(link)
            found = link.read(PARAMETERS["mechPos"], asked, (_ANSWER_TIME,), takes_late=True)
            if limp is not None:
                readings = limp.readings()
                fresh = link.line.clock() - readings.time <= _LATE
                found |= {i: float(readings.position[k]) for k, i in enumerate(unasked) if fresh[k]}
            now = time.monotonic()
            for i in chosen:
                position = found.get(i)
                if position is not None:
                    received[i] = now
                    angle, (lowest, highest) = float(wiring.direction[i]) * position, sweeps[i]
                    sweeps[i] = min(angle, lowest), max(angle, highest)  # NaN is neither
                elif now - received[i] > _SILENT:
                    motor = wiring.motors[i]
                    raise bench.silence(link, motor.channel, f"{motor.name} ({motor.motor_id}) does not answer")
            live.update(_table(wiring, sweeps, judge), refresh=True)
            time.sleep(_PERIOD)
    return sweeps


def _is_over() -> bool:
    if select.select([sys.stdin], [], [], 0.0)[0]:
        sys.stdin.readline()
        return True
    return False


def _table(wiring: Wiring, sweeps: Mapping[int, Sweep], judge: _Judge) -> Table:
    rows = []
    for i, sweep in sweeps.items():
        verdict, offset = judge(i, sweep)
        figures = [f"{number:.2f}" for number in (*sweep, sweep[1] - sweep[0], wiring.upper[i] - wiring.lower[i])]
        written = "" if offset is None else f"{offset:.3f}"
        rows.append([wiring.names[i], str(wiring.motors[i].motor_id), *figures, written, verdict.value])
    return bench.make_table(("joint", "id", "low", "high", "swept", "range", "offset", ""), rows)
