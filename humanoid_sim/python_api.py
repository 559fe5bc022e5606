"""The programs as functions, for notebooks and scripts: options are keywords, results are objects.

`humanoid_sim` offers them under its own name and loads them when they are used first. A result is shown as the program
prints it, in a notebook as tables. Bad input raises `humanoid_sim.errors.InputError` with the line that the program
would print.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar
from weakref import finalize

import numpy as np
from rich.console import Console

from humanoid_sim.assets import policy_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy_tools.show import print_checkpoint
from humanoid_sim.recording.reader import Recording, open_recording
from humanoid_sim.regress import RegressConfig
from humanoid_sim.robots.description import load_robot
from humanoid_sim.strict_yaml import converted

if TYPE_CHECKING:
    from humanoid_sim.regress.results import Results

_Config = TypeVar("_Config", PlayConfig, DoctorConfig, RegressConfig)
Given: TypeAlias = "str | Path | Policy"
"""A policy: the name of one that ships, a file, or one that was loaded."""
_PAGE = '<pre style="line-height: 1.2; font-family: monospace">{code}</pre>'


class _Shown:
    """A result that is shown as its program prints it."""

    def _print(self, console: Console) -> None:
        raise NotImplementedError

    def __repr__(self) -> str:
        return self._printed().export_text()

    def _repr_html_(self) -> str:
        return self._printed().export_html(inline_styles=True, code_format=_PAGE)

    def _printed(self) -> Console:
        console = Console(file=io.StringIO(), width=120, highlight=False, emoji=False, record=True, force_jupyter=False)
        self._print(console)
        return console


@dataclass(frozen=True, repr=False)
class Policy(_Shown):
    """A checkpoint with its contract, shown as `policy show` does."""

    name: str  # the file, or the name of a policy that ships, as it was given
    checkpoint: Checkpoint

    @classmethod
    def load(cls, path: str | Path, *, contract: str | Path | None = None, robot: str | None = None) -> Policy:
        """Load an ONNX file, or a policy that ships, without running it on a robot.

        Args:
            contract: a contract.yaml with what the checkpoint does not say; None: the one beside it.
            robot: whose joints they are, where the contract names them by their places.
        """
        joints = None if robot is None else load_robot(robot).joint_names
        file = None if contract is None else Path(contract)
        return cls(str(path), load_checkpoint(policy_path(path, "Policy.load"), file, joints, verify=False))

    @property
    def contract(self) -> PolicyContract:
        """Joints, observation, action, rates."""
        return self.checkpoint.contract

    def _print(self, console: Console) -> None:
        print_checkpoint(console, self.checkpoint)


@dataclass(frozen=True, repr=False)
class Simulation(_Shown):
    """A run that has ended, and its recording, shown as `play` reports it."""

    passed: bool  # it ended as planned: no controller failed, the robot did not fall, every file was written
    summary: Mapping[str, Any]  # the final table, as `play --summary` writes it, SI units and radians
    problems: tuple[str, ...]  # parts of the run that failed while it went on, a line each
    recording: Recording

    def _print(self, console: Console) -> None:
        from humanoid_sim.play.report import print_report  # noqa: PLC0415 - heavy

        print_report(console, dict(self.summary))
        for problem in self.problems:
            console.print(f"failed: {problem}", markup=False)


def simulate(policy: Given | None = None, *, record: str | Path | None = None, **options: Any) -> Simulation:
    """Run a policy on a simulated robot through the five modes, as fast as possible, and record every tick.

    Call it from the main thread; Ctrl-C ends the run through DAMPING.

    Args:
        policy: what runs; None: the robot's sample policy.
        record: the recording to write (.mcap); None: one that goes with the result.
        options: those of `play`, such as `robot="lite_biped"`, `command="0.3,0,0"`, `duration=5`,
            `script="damp; load_a"`; neither `hardware` nor `manual`, for whose operators `play` is.
    """
    from humanoid_sim.play.console import PlayConsole  # noqa: PLC0415 - MuJoCo, and all that runs a robot
    from humanoid_sim.play.run import played  # noqa: PLC0415

    if threading.current_thread() is not threading.main_thread():  # which alone may handle signals
        raise InputError("simulate: is called in another thread, expected the main one")
    for name in ("hardware", "manual"):
        if options.get(name):
            raise InputError(f"simulate: {name} is {options[name]!r}, expected none; an operator's runs are play's")
    with ExitStack() as stack:
        folder = Path(mkdtemp(prefix="humanoid_sim-"))
        stack.callback(rmtree, folder, ignore_errors=True)
        path = (folder / "run.mcap" if record is None else Path(record)).absolute()
        chosen = {} if policy is None else {"policy": [_path_of(policy)], **_contract_of(policy)}
        given = {"viewer": "none", "html": "none", **options, **chosen, "record": path}
        outcome = played(_config("simulate", PlayConfig, given), PlayConsole(quiet=True))
        if outcome.status > 128:
            raise KeyboardInterrupt
        recording = open_recording(path)
        finalize(recording, stack.pop_all().close)  # a reader may outlive this run
    return Simulation(outcome.status == 0, outcome.summary, outcome.problems, recording)


@dataclass(frozen=True, repr=False)
class Diagnosis(_Shown):
    """Findings of `policy doctor`, shown as it prints them."""

    document: Mapping[str, Any]  # as `policy doctor --json` prints it: `healthy`, `verdict`, `ranking`, `fix`

    def _print(self, console: Console) -> None:
        from humanoid_sim.doctor.report import print_document  # noqa: PLC0415

        print_document(dict(self.document), console)


def diagnose(policy: Given, robot: str, *, quiet: bool = False, **options: Any) -> Diagnosis:
    """Find out what is wired wrongly in a policy that does not behave; shows how far it is unless `quiet`.

    Args:
        robot: a shipped robot, `robot_descriptions:NAME`, a YAML file or an MJCF.
        options: those of `policy doctor`, such as `motion`, `trace`.
    """
    from humanoid_sim.doctor.report import examine  # noqa: PLC0415 - MuJoCo, and all that runs a robot

    given = {"checkpoint": policy_path(_path_of(policy), "diagnose"), "robot": robot, **_contract_of(policy)}
    config = _config("diagnose", DoctorConfig, {**options, **given})
    return Diagnosis(examine(config, Console(stderr=True, quiet=quiet)))


@dataclass(frozen=True, repr=False)
class SuiteRun(_Shown):
    """Findings of `regress`, shown as it prints them."""

    results: Results  # everything, as `regress --json` writes it

    @property
    def passed(self) -> bool:
        """Return whether no policy is worse than the baseline by more than the suite tolerates."""
        return self.results.passed

    def _print(self, console: Console) -> None:
        from humanoid_sim.regress.report import print_results  # noqa: PLC0415

        print_results(console, self.results)


def run_suite(policies: Given | Iterable[Given], baseline: Given | None = None, **options: Any) -> SuiteRun:
    """Run policies over a suite and compare them with a baseline; shows how far it is.

    Args:
        baseline: what to compare with: a policy, or a file that `regress --json` wrote.
        options: those of `regress`, such as `suite="lite_biped"`, `seeds=8`, `report="report.html"`.
    """
    from humanoid_sim.regress.run import tested  # noqa: PLC0415 - MuJoCo, and all that runs a robot

    several = [policies] if isinstance(policies, str | Path | Policy) else policies
    given = {**options, "policies": [_path_of(policy) for policy in several]}
    if baseline is not None:
        given["baseline"] = _path_of(baseline)
    return SuiteRun(tested(_config("run_suite", RegressConfig, given)))


def _path_of(policy: Given) -> str:
    return policy.name if isinstance(policy, Policy) else str(policy)


def _contract_of(policy: Given) -> dict[str, Path]:
    """Return the option with the file of a loaded policy's contract, if it has one."""
    file = policy.checkpoint.contract_file if isinstance(policy, Policy) else None
    return {} if file is None else {"contract": file}


def _config(function: str, kind: type[_Config], given: Mapping[str, Any]) -> _Config:
    """Return a program's options from keywords. Raises `InputError` for one that does not exist, or a wrong value."""
    require_known("option", given, [item.name for item in fields(kind)], f"{function}: ")
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in given.items()}
    texts = {name: str(value) if isinstance(value, Path) else value for name, value in plain.items()}
    return converted(texts, kind, function, dec_hook=lambda wanted, value: wanted(value))
