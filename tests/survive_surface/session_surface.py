"""The only place where the tests of session, operator and front ends touch names of the product.

A rewrite of session/, play/ or frontends/ changes this file and no test in tests/survive/.
"""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import onnx
import yaml
from fake_pads import JOYSTICK, XBOX, FakePads
from onnx import helper, numpy_helper

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.client import Feed, Intake, SessionError, find_session, monotonic_ns
from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.frontends.pads import Pads
from humanoid_sim.gamepad import Driver
from humanoid_sim.messages import (
    Event,
    Intent,
    Mode,
    SafetyLevel,
    SessionHeader,
    TickInput,
    TickOutput,
    TickRecord,
)
from humanoid_sim.mit import MITCommand
from humanoid_sim.play import main
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.losses import DeviceWatch, Interruption
from humanoid_sim.session.outside_safety import OutsideSafety
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.registration import Registration
from humanoid_sim.session.session import Session
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import IntentSource
from humanoid_sim.stack import build_supervisor

_LITE = load_robot("lite")
JOINTS = _LITE.joint_names
REST_POSITION = np.array(_LITE.initial_position)
"""Shape (n,), rad: a pose within every limit."""
PERIOD = 0.02
"""s between two ticks of a `FakeRun`."""


# The loop alone, on a fake robot.


class VirtualClock:
    """Time passes when somebody sleeps, and a little with every look at the clock."""

    now = 100.0
    """s"""

    def read(self) -> float:
        self.now += 1e-6
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@dataclass(frozen=True)
class Ended:
    """Outcome of a run."""

    ticks: int
    overruns: int
    skipped: int
    """Deadlines that passed while a tick was still running."""
    failures: tuple[str, ...]
    """Parts that failed while the run went on."""


class FakeRun:
    """The control loop with the Lite's controllers on a fake robot; `run` blocks until it has ended."""

    def __init__(
        self,
        robot: Any,
        *,
        sinks: Sequence[Any] = (),
        intents: Callable[[int], Sequence[Intent]] = lambda _: (),
        on_step: Callable[[TickInput], object] = lambda _: None,
        duration: float | None = None,
        clock: VirtualClock | None = None,
    ) -> None:
        """Put the parts together; nothing moves yet.

        Args:
            robot: has `joints`, `activate`, `read`, `write` and `close`.
            sinks: each has `tick(record)`, `event(text)` and `close()`.
            intents: returns those of a poll by its number, one poll a tick.
            on_step: called with what the control stack is about to decide on.
            duration: s on the robot's clock; None: until QUIT or `stop`.
            clock: real time is kept on it, and a standstill of the process noticed; None: without real time.
        """
        supervisor = build_supervisor(_LITE, PERIOD, None)
        kind = type(supervisor)
        step = kind.step

        def stepped(self: Any, memory: Any, tick_input: TickInput) -> Any:
            on_step(tick_input)
            return step(self, memory, tick_input)

        self._patches = [patch.object(kind, "step", stepped)]
        sources: list[IntentSource] = [_Source(intents)]
        interruption = None
        if clock is not None:
            interruption = Interruption(0.1, self._note, clock=lambda: clock.now)
            sources.insert(0, interruption)
            for module in ("session", "pace"):
                self._patches.append(patch(f"humanoid_sim.session.{module}.perf_counter", clock.read))
                self._patches.append(patch(f"humanoid_sim.session.{module}.sleep", clock.sleep))
        self._session = Session(
            robot,
            supervisor,
            LoopSettings(PERIOD, realtime=clock is not None, duration=duration),
            header=SessionHeader("lite", JOINTS, PERIOD, 0),
            intents=sources,
            sinks=[_Sink(sink) for sink in sinks],
            interruption=interruption,
        )

    def _note(self, text: str) -> None:
        self._session.event(text)

    def stop(self, reason: str = "SIGTERM") -> None:
        """End the run, as the handler of a signal does."""
        self._session.request_stop(reason)

    def run(self) -> Ended:
        with ExitStack() as stack:
            for one in self._patches:
                stack.enter_context(one)
            result = self._session.run()
        return Ended(result.ticks, result.overruns, result.skipped, tuple(result.failures))


class _Source(IntentSource):
    def __init__(self, intents: Callable[[int], Sequence[Intent]]) -> None:
        self._intents, self._polls = intents, 0

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        self._polls += 1
        return self._intents(self._polls - 1)


class _Sink(Sink):
    def __init__(self, sink: Any) -> None:
        self._sink = sink

    def tick(self, record: TickRecord) -> None:
        self._sink.tick(record)

    def event(self, event: Event) -> None:
        self._sink.event(event.text)

    def close(self) -> None:
        self._sink.close()


# The command line, in this process.

Operator = Generator[None, TickRecord, None]
"""Gets every tick once it is over, on the loop's thread; its first `yield` is before the run."""


@dataclass
class Played:
    """What a run of `play` printed and left behind."""

    status: int
    out: str
    err: str
    ticks: list[TickRecord] = field(default_factory=list)
    is_complete: bool = False
    """The recording was ended as it should be."""

    @property
    def modes(self) -> list[Mode]:
        return [tick.output.control_mode.mode for tick in self.ticks]


class Conditions:
    """What a test says of the world around a run."""

    aged = 0.0
    """s that have passed for watchdogs beside the time that has really passed."""
    out: Callable[[], str] = staticmethod(lambda: "")
    """What was printed so far."""


class _Watch:
    def __init__(self, operator: Operator | None) -> None:
        self._operator, self.error = operator, None if operator is None else AssertionError("the run ended too early")
        if operator is not None:
            next(operator)

    def tick(self, record: TickRecord) -> None:
        if self._operator is None:
            return
        try:
            self._operator.send(record)
        except StopIteration:
            self._operator = self.error = None
        except Exception as error:
            self._operator, self.error = None, error  # raised where the run is over
            signal.raise_signal(signal.SIGTERM)

    def close(self) -> None:
        if self._operator is not None:
            self._operator.close()
        if self.error is not None:
            raise self.error


def play(*arguments: str, operator: Operator | None = None, stdin: Any = None, around: Any = None) -> Played:
    """Run `play` in this folder; without a window or a gamepad, and never seen as standing still.

    Args:
        operator: acts between ticks; the run records to r.mcap then. What it raises is raised here, and it must finish.
        stdin: standard input; None: not a terminal.
        around: `Conditions`.
    """
    around = around or Conditions()
    out, err = io.StringIO(), io.StringIO()
    around.out = out.getvalue
    options = [*arguments, "--viewer", "none", "--video", "none"]
    if "--record" not in arguments:
        options += ["--record", "r.mcap", "--overwrite"]
    record, watch = McapRecorder.tick, _Watch(operator)

    def ticked(self: Any, tick: TickRecord) -> None:
        record(self, tick)
        watch.tick(tick)

    clock = partial(OutsideSafety, clock=lambda: monotonic_ns() + round(1e9 * around.aged))
    with ExitStack() as stack:
        stack.enter_context(redirect_stdout(out))
        stack.enter_context(redirect_stderr(err))
        stack.enter_context(patch("sys.stdin", stdin or io.StringIO()))
        stack.enter_context(patch.object(McapRecorder, "tick", ticked))
        stack.enter_context(patch("humanoid_sim.play.assembly.OutsideSafety", clock))
        stack.enter_context(patch("humanoid_sim.play.assembly._STANDSTILL", 1e9))
        stack.enter_context(patch("humanoid_sim.play.front_ends.Pads", partial(Pads, Path("no pads"))))
        stack.enter_context(_unhandled_signals_raise())
        try:
            status = run_program(main, options)
        except SystemExit as stop:  # the way out of what parses the command line
            status = int(stop.code or 0)
    played = Played(status, out.getvalue(), err.getvalue())
    if operator is not None or Path("r.mcap").exists():
        watch.close()
        played.ticks, played.is_complete = read_ticks("r.mcap")
    return played


@contextmanager
def _unhandled_signals_raise() -> Iterator[None]:
    """A signal that `play` does not handle is a failure of the test, and not the end of the test runner."""

    def unhandled(number: int, _: object) -> None:
        raise AssertionError(f"{signal.Signals(number).name} was not handled")

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    before = [signal.signal(number, unhandled) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def read_ticks(path: str | Path) -> tuple[list[TickRecord], bool]:
    """Return the ticks of a recording, and True if it was ended as it should be."""
    recording = open_recording(path)
    ticks = list(recording.ticks())
    return ticks, recording.is_complete


def quick_robot(folder: Path, name: str = "lite") -> str:
    """Write a shipped robot's file whose standby poses are where it starts, reached in 0.2 s; return its path."""
    document = yaml.safe_load(asset_path("robots", f"{name}.yaml").read_text(encoding="utf-8"))
    document["mjcf"] = str((asset_path("robots") / document["mjcf"]).resolve())
    for pose in ("a", "b"):
        standby = document[f"standby_controller_{pose}"]
        standby["pose_segments"] = [document["initial_position"]] * 2
        standby["segment_durations"] = [0.1, 0.1]
    path = folder / f"quick_{name}.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return str(path)


def joint_names(robot: str) -> tuple[str, ...]:
    """Joints of a robot's file, in order."""
    return load_robot(robot).joint_names


def quick_policy(folder: Path, term: Any, width: int) -> str:
    """Write a policy of the Lite that observes joint positions and one more term; it answers zeros. Return its path."""
    weights = np.zeros((len(JOINTS) + width, len(JOINTS)), dtype=np.float32)
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["observation", "weights"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("observation", onnx.TensorProto.FLOAT, [1, weights.shape[0]])],
        [helper.make_tensor_value_info("action", onnx.TensorProto.FLOAT, [1, weights.shape[1]])],
        [numpy_helper.from_array(weights, "weights")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, str(folder / "quick.onnx"))
    contract = {
        "task_type": "locomotion",
        "joint_names": list(JOINTS),
        "observation": ["joint_pos", term],
        "default_joint_pos": REST_POSITION.tolist(),
        "joint_stiffness": 50,
        "joint_damping": 2,
        "action_scale": 0.01,
        "policy_dt": 0.02,
    }
    (folder / "contract.yaml").write_text(json.dumps(contract), encoding="utf-8")
    return str(folder / "quick.onnx")


class OtherProgram:
    """A program of the same user beside the run in this process; what it sends arrives in the next tick."""

    def __init__(self, name: str = "program") -> None:
        self._intake = Intake(find_session(os.getpid()), name)

    def __enter__(self) -> OtherProgram:
        return self

    def __exit__(self, *_: object) -> None:
        self._intake.close()

    def ask(self, intent: Intent) -> None:
        self._intake.post(intent.value)

    def report(self, source: str, level: SafetyLevel) -> None:
        self._intake.post_safety(source, level)

    def velocity(self, vx: float, vy: float, wz: float) -> None:
        self._intake.velocity(vx, vy, wz, deliberate=True)

    def live(self, name: str, values: Sequence[float]) -> None:
        self._intake.live(name, values)

    def remote(self, joints: Sequence[str], command: MITCommand) -> None:
        names = ("position", "velocity", "effort", "stiffness", "damping")
        self._intake.remote(joints, *(getattr(command, name).tolist() for name in names))


# The command line, as a process.


def _usual_signals() -> None:
    """Undo what a test runner may have inherited, in a child that is about to be started."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP, signal.SIGCONT):
        signal.signal(number, signal.SIG_DFL)


@contextmanager
def playing(*arguments: str, **popen: Any) -> Iterator[subprocess.Popen]:
    """Run `play` as a process that records to r.mcap in this folder; killed in the end if it still runs."""
    command = [sys.executable, "-m", "humanoid_sim.play", "--viewer", "none", "--video", "none", "--record", "r.mcap"]
    with subprocess.Popen([*command, *arguments], preexec_fn=_usual_signals, **popen) as process:  # noqa: PLW1509
        try:
            yield process
        finally:
            process.kill()


def reach(process: subprocess.Popen, mode: Mode, act: Callable[[], object] = lambda: None) -> None:
    """Wait until a process is in a mode, and act ten times a second until then."""
    deadline = time.monotonic() + 60.0
    while _mode_of(process) is not mode:
        assert process.poll() is None, f"it ended before it reached {mode.name}"
        assert time.monotonic() < deadline, f"it never reached {mode.name}"
        act()
        time.sleep(0.1)


def _mode_of(process: subprocess.Popen) -> Mode | None:
    try:
        with Feed(find_session(process.pid)) as feed:
            sample = feed.wait(0, 1.0)
            return None if sample is None else Mode(feed.decode(sample)["mode"])
    except SessionError:
        return None


# Devices.


PAGE_SOCKET = "console"
"""Where the page's socket opens, below the page's own address."""


def page_address(out: str) -> tuple[int, str, str] | None:
    """Return port, path and token of the page whose address was printed; None as long as there is none."""
    found = re.search(r"http://127\.0\.0\.1:(\d+)(/([\w-]+)/)", out)
    return None if found is None else (int(found[1]), found[2], found[3])


class PadDesk:
    """A loop on a fake robot whose operator has a gamepad, looked at once a tick."""

    def __init__(self, stack: ExitStack, robot: Any, *, is_hardware: bool) -> None:
        self._pads = FakePads(Path(stack.enter_context(TemporaryDirectory())))
        stack.callback(self._pads.close)
        registration = stack.enter_context(closing(Registration()))
        intents = IntentSocket(registration.path / "intents")
        stack.callback(intents.close)
        clock = lambda: self._session.time  # noqa: E731
        data = DataSocket(registration.path / "data", JOINTS, 0.1, clock=clock)
        stack.callback(data.close)
        registration.register(robot="lite", policy="none", hardware="can0" if is_hardware else "")
        intake = stack.enter_context(Intake(find_session(os.getpid()), "gamepad"))
        self._driver = Driver(intake, JoyBindings(), speeds=None, is_hardware=is_hardware)
        self._ticks: list[TickRecord] = []
        kept = _Sink(SimpleNamespace(tick=self._ticks.append, event=lambda _: None, close=lambda: None))
        watch = [DeviceWatch("gamepad", lambda: data.heartbeats, lambda _: None)] if is_hardware else []
        self._session = Session(
            robot,
            build_supervisor(_LITE, PERIOD, None),
            LoopSettings(PERIOD, realtime=False),
            header=SessionHeader("lite", JOINTS, PERIOD, 0),
            intents=[*watch, intents],
            externs=[data],
            sinks=[intents, data, kept],
        )
        self.ask = stack.enter_context(OtherProgram("operator")).ask
        """Ask for an intent as another program."""
        self._stack, self._pad = stack, None

    @property
    def has_quit(self) -> bool:
        """True if QUIT was granted."""
        return any(record.output.quit for record in self._ticks)

    def plug(self, *, held: Sequence[str] = (), is_known: bool = True) -> None:
        """Plug a gamepad in, with these buttons down; an unknown one has six buttons that nobody knows."""
        self._pad = self._pads.plug(XBOX if is_known else JOYSTICK, held=held)
        self._stack.callback(self.unplug)

    def unplug(self) -> None:
        self._pad.unplug()

    def press(self, *buttons: str | int) -> Mode:
        """Press buttons at once, and release them; the mode that they led to."""
        self._pad.press(*buttons)
        mode = self.tick()
        self._pad.release(*buttons)
        self.tick()
        return mode

    def tick(self, count: int = 1, *, program_runs: bool = True) -> Mode:
        """Let the gamepad's program look, unless it hangs, and the loop take a tick; the mode after the last."""
        for _ in range(count):
            if program_runs:
                self._driver.step(self._pads.poll())
            self._session.tick()
        return self._session.mode


@contextmanager
def pad_desk(robot: Any, *, is_hardware: bool = True) -> Iterator[PadDesk]:
    with ExitStack() as stack:
        yield PadDesk(stack, robot, is_hardware=is_hardware)
