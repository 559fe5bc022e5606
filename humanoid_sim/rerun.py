"""rerun's viewer, on a running session: the robot and its plots, in a window or on a page for browsers.

The viewer is a program of its own, which ends with this one, however this one ends. It only shows.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError
from humanoid_sim.frontends.attach import Source
from humanoid_sim.frontends.dds.mirror import Watched
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.recording.links import Links
from humanoid_sim.recording.topics import read_labels
from humanoid_sim.rendering.pictures import has_display
from humanoid_sim.rendering.rerun_log import RerunLog, rerun_module

_HOST = "127.0.0.1"
_PERIOD = 0.04  # s of the robot's time between two poses: each costs the library some 20 calls
_STATUS_PERIOD = 0.5  # s between two statuses, and two checks that the viewer keeps up
_STARTING = 25.0  # s that the viewer may take to be there
_MEMORY = "1GB"  # that the viewer keeps at most; the oldest is dropped
_PLOTS = ("position", "command", "velocity", "effort", "action")
_PR_SET_PDEATHSIG = 1  # Linux, prctl(2)


@dataclass(frozen=True)
class RerunConfig(Watched):
    """Watch a running session in rerun's viewer: the robot, and plots of its joints."""

    web: bool = False
    """A page for browsers on this machine, in place of a window; also where there is no display."""


def status_text(record: TickRecord | None, late: str, clock: str) -> str:
    """Return what the viewer's text says of the present, as Markdown.

    Args:
        late: that it is not the present; empty if it is.
        clock: the time of day, by which a picture that stands still gives itself away.
    """
    if record is None:
        return f"# no tick yet\n\n{clock}"
    control, now = record.output.control_mode, float(record.input.state.time)
    return f"# {late or control.mode.name}\n\n{control.status_message}\n\n{clock}, robot's clock {now:.1f} s"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends or the viewer is closed; returns the exit status."""
    config = parse(RerunConfig, "rerun", arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with config.source("rerun", niceness=10) as source:
        _show(source, is_page=config.web)
    return 0


def _show(source: Source, *, is_page: bool) -> None:
    """Show ticks until the session or the viewer has ended."""
    body = Links.of(source.header)
    if body is None:
        raise InputError(f"{source}: does not describe its robot's body")
    with _viewer(is_page=is_page or not has_display()) as (viewer, address, serves):
        os.environ["RUST_LOG"] = "off"  # what the library has to say of a viewer that was closed is no news
        library = rerun_module("the rerun viewer")
        stream = library.RecordingStream("humanoid_sim")
        stream.connect_grpc(address)
        has_keys = source.description.piano is not None or KEY_PRESSED in source.live_inputs
        stream.send_blueprint(_blueprint(has_keys=has_keys))
        names = read_labels(source.header).action
        log = RerunLog(library, stream, source.header.joint_names, body, names, _PERIOD)
        print(f"{serves}, for {source}", flush=True)
        # What waits for the viewer is kept short: the library's queue would grow without end.
        keeps_up, reported = True, 0.0
        while viewer.poll() is None and source.is_running():
            for tick in source.ticks(_PERIOD):
                if keeps_up:
                    log.tick(tick.record)
            if time.monotonic() - reported > _STATUS_PERIOD:
                text = status_text(source.latest_record, source.lateness(), time.strftime("%H:%M:%S"))
                if keeps_up:
                    stream.log("status", library.TextDocument(text, media_type=library.MediaType.MARKDOWN), static=True)
                keeps_up, reported = _has_taken(stream), time.monotonic()
        if viewer.poll():
            raise InputError(f"rerun: its viewer ended with status {viewer.poll()}")
        stream.disconnect()


def _has_taken(stream: Any) -> bool:
    """Return whether the viewer has taken all that was sent, or takes it soon."""
    try:
        stream.flush(timeout_sec=_STATUS_PERIOD)
    except Exception:  # of the library's own kinds: it has not taken it in time, or is gone
        return False
    return True


def _blueprint(*, has_keys: bool) -> Any:
    """Return the robot beside its status and its plots, and a piano's keys below it."""
    import rerun.blueprint as views  # noqa: PLC0415 - an extra

    plots = {name: views.TimeSeriesView(origin=f"plots/{name}", name=name) for name in _PLOTS}
    places = views.Tabs(plots["position"], plots["command"])
    rest = views.Tabs(plots["effort"], plots["velocity"], plots["action"])
    side = views.Vertical(views.TextDocumentView(origin="status", name="status"), places, rest, row_shares=[2, 3, 3])
    robot = views.Spatial3DView(origin="/", name="robot")
    if has_keys:
        robot = views.Vertical(robot, views.BarChartView(origin="keys", name="keys"), row_shares=[4, 1])
    return views.Blueprint(views.Horizontal(robot, side, column_shares=[3, 2]), collapse_panels=True)


@contextlib.contextmanager
def _viewer(*, is_page: bool) -> Iterator[tuple[subprocess.Popen[bytes], str, str]]:
    """Start the viewer, on this machine's own address alone, and end it.

    Yields its process, the address at which it takes data, and a line for an operator. Raises `InputError` if it does
    not come.
    """
    import rerun_cli  # noqa: PLC0415 - an extra

    port, page = _free_port(), _free_port()
    source = f"rerun+http://{_HOST}:{port}/proxy"
    program = str(Path(rerun_cli.__file__).with_name("rerun"))
    command = [program, "--bind", _HOST, "--port", str(port), "--memory-limit", _MEMORY]
    serves = "rerun's window"
    if is_page:
        command += ["--serve-web", "--web-viewer-port", str(page), "--server-memory-limit", "256MB"]
        serves = f"rerun's page: http://{_HOST}:{page}/?url={quote(source, safe='')}"
    else:
        command += ["--hide-welcome-screen", "--expect-data-soon"]
    parent = os.getpid()

    def end_with_parent() -> None:  # a picture that nobody says is the past must not stay
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)

    quiet = {**os.environ, "RUST_LOG": "error"}
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        env=quiet,
        preexec_fn=end_with_parent,  # noqa: PLW1509 - one system call
    )
    try:
        for needed in (port, page) if is_page else (port,):
            _wait_for(process, needed)
        yield process, source, serves
    finally:
        process.terminate()
        try:
            process.wait(2.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_HOST, 0))
        return int(probe.getsockname()[1])


def _wait_for(viewer: subprocess.Popen[bytes], port: int) -> None:
    deadline = time.monotonic() + _STARTING
    while viewer.poll() is None and time.monotonic() < deadline:
        with contextlib.suppress(OSError), socket.create_connection((_HOST, port), timeout=1.0):
            return
        time.sleep(0.05)
    raise InputError(f"rerun: its viewer is not there after {_STARTING:g} s, status {viewer.poll()}")


if __name__ == "__main__":
    sys.exit(run_program(main))
