"""What becomes of a run whose front ends are stopped or killed: who there is, what each may cost, and how to strike."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from dds_bridge import free_domain
from models import linear_model
from waiting import until

from humanoid_sim import replay
from humanoid_sim.cli import FRONT_ENDS, run_program
from humanoid_sim.client import Feed, Intake, SessionError, SessionInfo, find_session
from humanoid_sim.messages import Event, Mode, TickRecord
from humanoid_sim.recording.reader import Recording, open_recording
from humanoid_sim.robots.description import load_robot


@dataclass(frozen=True)
class Row:
    """What a front end may cost the robot when it is lost."""

    options: tuple[str, ...]
    """Of `play`, which starts it."""
    remote: bool = False
    """It commands in REMOTE: lost there, the joints are damped. Elsewhere its loss changes nothing."""
    feeds: bool = False
    """A policy observes what it tells: lost, that policy is stopped, and nothing else changes."""
    operates: bool = False
    """The declared operator's device: on hardware its loss is a DAMP."""
    window: bool = False
    """It needs a display."""
    instead: bool = False
    """Of the window: it is tried by itself, where there is no display."""


ROWS = {
    "console": Row(("--console",)),
    "dds": Row(("--dds",)),
    "gamepad": Row(("--gamepad",), operates=True),
    "gravity": Row(("--remote", "gravity"), remote=True),
    "midi": Row(("--midi", "./keys"), feeds=True),
    "rerun": Row(("--viewer", "rerun"), instead=True),
    "viewer": Row(("--viewer", "native"), window=True),
}
"""Each front end that `play` starts: what is not here has no proof."""

BLOWS = {"stopped": signal.SIGSTOP, "killed": signal.SIGKILL}

WALK = {
    Mode.ZERO_TORQUE: "",
    Mode.DAMPING: "damp; ",
    Mode.STANDBY: "damp; hold 0.2; load_a; wait; ",
    Mode.LOCOMOTION: "damp; hold 0.2; load_a; wait; start_locomotion; ",
    Mode.REMOTE: "damp; hold 0.2; load_a; wait; start_remote; ",
}
"""Into each mode."""
STAY = 2.0
"""s on the robot's clock in that mode: the blow falls soon after its begin."""
PATIENCE = 60.0
"""s for anything that only has to happen."""


def script(mode: Mode, lead: float = 0.3) -> str:
    """Into a mode, `lead` s after the begin, and out of it through DAMPING."""
    return f"hold {lead:g}; {WALK[mode]}hold {STAY:g}; damp; hold 0.5"


def available(names: Sequence[str]) -> list[str]:
    """Those whose packages are installed."""
    has_display = shutil.which("Xvfb") is not None
    return [
        name
        for name in names
        if all(find_spec(package) is not None for package in FRONT_ENDS[name].packages)
        and (has_display or not ROWS[name].window)
    ]


def watchers(alone: str, mode: Mode, names: Sequence[str]) -> list[str]:
    """Those who only look on in a mode, as far as they are installed; or the one that is there in place of a window."""
    if alone:
        if not available([alone]):
            pytest.skip(f"the packages of {alone} are not installed")
        return [alone]
    rows = {name: ROWS[name] for name in available(names)}
    return [
        name for name, row in rows.items() if not (row.instead or row.feeds or (row.remote and mode is Mode.REMOTE))
    ]


def skip_unless(is_sampled: bool, request: pytest.FixtureRequest) -> None:
    if not is_sampled and not request.config.getoption("--complete"):
        pytest.skip("a sample without --complete")


@pytest.fixture
def rows(table_of: Callable[[str, tuple[str, ...]], list[tuple[str, ...]]]) -> list[tuple[str, ...]]:
    return table_of("front ends lost", ("front end", "fate", "mode", "where", "what became of the robot"))


@pytest.fixture
def folder(tmp_path: Path, runtime: Path) -> Path:
    return tmp_path


@contextmanager
def display() -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """An X server, and the name of its display."""
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "800x600x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL) as server:
        os.close(writing)
        try:
            with open(reading, encoding="ascii") as stream:
                yield server, f":{stream.readline().strip()}"
        finally:
            server.kill()


@dataclass
class Played:
    """`play` in a process of its own, in a folder of its own, recording to `r.mcap`."""

    process: subprocess.Popen[bytes]
    folder: Path
    feed: Feed
    operator: Intake
    domain: int
    """Of DDS, that nobody else is in."""

    @property
    def said(self) -> str:
        return (self.folder / "out.txt").read_text(encoding="utf-8", errors="replace")

    def mode(self) -> Mode | None:
        sample = self.feed.latest()
        return None if sample is None else Mode(self.feed.decode(sample)["mode"])

    def reach(self, mode: Mode, seconds: float = PATIENCE) -> bool:
        """Wait until the script is there; whether it came there in time."""
        deadline = time.monotonic() + seconds
        while self.mode() is not mode:
            if self.process.poll() is not None or time.monotonic() > deadline:
                return False
            time.sleep(0.002)
        return True

    def until_owned(self, what: str, name: str) -> None:
        """Wait until REMOTE or the velocity belongs to a producer."""
        until(lambda: str(self.feed.status().get("owners", {}).get(what, "")).startswith(f"{name} "))

    def strike(self, names: Sequence[str], blow: signal.Signals) -> None:
        """Stop or kill children, and mark the moment."""
        children = until(lambda: self.feed.status().get("front_ends"))
        for name in names:
            os.kill(children[name], blow)
        self.operator.ask("mark blow")

    def finish(self) -> "Log":
        """Wait for the end; what was recorded."""
        self.process.wait(PATIENCE)
        return Log(self.folder, self.process.returncode)


@contextmanager
def playing(folder: Path, *options: str, screen: str = "") -> Iterator[Played]:
    """A run, once it can be reached; killed if it is not over at the end."""
    domain = free_domain()
    environment = {**os.environ, "NO_COLOR": "1", "ROS_DOMAIN_ID": str(domain)}
    environment.pop("DISPLAY", None)
    if screen:
        environment["DISPLAY"] = screen
    viewer = () if "--viewer" in options else ("--viewer", "none")
    results = ("--html", "none", "--record", "r.mcap", "--summary", "s.json", "--overwrite")
    command = [sys.executable, "-m", "humanoid_sim.play", *options, *viewer, *results]
    with ExitStack() as stack:
        out = stack.enter_context(open(folder / "out.txt", "wb"))
        nothing = stack.enter_context(open(os.devnull, "rb"))
        process = stack.enter_context(
            subprocess.Popen(command, cwd=folder, stdin=nothing, stdout=out, stderr=out, env=environment)
        )
        stack.callback(process.kill)
        session = until(lambda: _session(process, folder))
        feed = stack.enter_context(Feed(session))
        yield Played(process, folder, feed, stack.enter_context(Intake(session, "test")), domain)


def _session(process: subprocess.Popen[bytes], folder: Path) -> SessionInfo | None:
    assert process.poll() is None, (folder / "out.txt").read_text(encoding="utf-8")
    try:
        return find_session(process.pid)
    except SessionError:
        return None


@dataclass(frozen=True)
class Log:
    """What a run left behind."""

    folder: Path
    status: int
    """Of its exit."""

    @cached_property
    def recording(self) -> Recording:
        return open_recording(self.folder / "r.mcap")

    @cached_property
    def ticks(self) -> list[TickRecord]:
        return list(self.recording.ticks())

    @cached_property
    def events(self) -> list[Event]:
        return [entry for entry in self.recording.entries() if isinstance(entry, Event)]

    @cached_property
    def summary(self) -> dict[str, Any]:
        return dict(json.loads((self.folder / "s.json").read_text(encoding="utf-8")))

    @property
    def blow(self) -> float:
        """s, robot's clock."""
        return next(event.time for event in self.events if event.text.endswith(": blow"))

    def mode_at(self, time: float) -> Mode:
        return next(tick.output.control_mode.mode for tick in self.ticks if tick.input.state.time >= time)

    @property
    def course(self) -> list[tuple[Mode, str]]:
        """Modes and controllers, in the order in which they came."""
        found: list[tuple[Mode, str]] = []
        for tick in self.ticks:
            control = tick.output.control_mode
            if not found or found[-1] != (control.mode, control.controller_name):
                found.append((control.mode, control.controller_name))
        return found

    @property
    def ended(self) -> dict[str, str]:
        """Front ends that ended during the run, and their exit status."""
        texts = [event.text.split() for event in self.events]
        return {words[2]: words[-1] for words in texts if words[:2] == ["front", "end"] and words[3] == "ended"}

    def is_exact(self) -> bool:
        """Whether the recording is complete, and repeats bit for bit."""
        return self.recording.is_complete and run_program(replay.main, [str(self.folder / "r.mcap")]) == 0

    def silence(self) -> float:
        """s from the arrival of the last command that was in force in REMOTE to the first tick that was passive.

        Of a producer that commands efforts, as those that are tried here do.
        """
        in_force = [tick for tick in self.ticks if tick.output.command.effort.any()]
        assert in_force, "it commanded"
        after = next(tick for tick in self.ticks if tick.index > in_force[-1].index)
        assert after.output.control_mode.mode is Mode.REMOTE, "it ended by the blow, not with the mode"
        assert not after.output.command.stiffness.any()
        assert (after.output.command.damping > 0.0).all()
        return float(after.input.state.time) - in_force[-1].input.remote.arrival_time

    def control(self) -> list[tuple[object, ...]]:
        """Every tick's mode, controller, pose and command, bit for bit."""
        found = []
        for tick in self.ticks:
            command, control = tick.output.command, tick.output.control_mode
            fields = (command.position, command.velocity, command.effort, command.stiffness, command.damping, tick.qpos)
            found.append((control.mode, control.controller_name, *(np.asarray(field).tobytes() for field in fields)))
        return found


CONTRACT = """
task_type: locomotion
joint_names: {joints}
observation: [joint_pos, velocity_commands]
default_joint_pos: {pose}
joint_stiffness: 50
joint_damping: 2
action_scale: 0.01
policy_dt: 0.02
"""


def walking_lite(folder: Path) -> str:
    """The path of a policy for the Lite that observes a velocity."""
    lite = load_robot("lite")
    pose = list(lite.standby_controller_a.pose_segments[-1])
    onnx.save(linear_model({}, inputs=lite.joint_count + 3, outputs=lite.joint_count), str(folder / "walk.onnx"))
    text = CONTRACT.format(joints=json.dumps(lite.joint_names), pose=pose)
    (folder / "contract.yaml").write_text(text, encoding="utf-8")
    return str(folder / "walk.onnx")
