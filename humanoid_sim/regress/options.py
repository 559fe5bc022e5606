"""What the options of `regress` mean together, checked before anything runs."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file
from humanoid_sim.regress.config import RegressConfig
from humanoid_sim.regress.report import require_report
from humanoid_sim.regress.suite import Suite
from humanoid_sim.regress.suite_checks import suite_problems

__all__ = ["check_outputs", "chosen_suite"]


def check_outputs(config: RegressConfig) -> None:
    """Refuse outputs that could not be written at the end of a long run.

    Raises:
        InputError: naming the option.
    """
    if not config.policies:
        raise InputError("POLICIES: is empty, expected one or more ONNX checkpoints")
    files = {
        "--write-baseline": (config.write_baseline, ".json"),
        "--json": (config.json, ".json"),
        "--junit": (config.junit, ".xml"),
        "--report": (config.report, ".html"),
    }
    named: dict[Path, str] = {}
    for option, (path, suffix) in files.items():
        if path is None:
            continue
        output_file(path, option, suffix, overwrite=config.overwrite)
        other = named.setdefault(path.absolute(), option)
        if other != option:
            raise InputError(f"{option}: is '{path}', as {other} is; expected different files")
    folder = config.record_failures
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError(f"--record-failures: '{folder}' is a file, expected a folder")
    for name, number in (("--record-limit", config.record_limit), ("--threads", config.threads)):
        if number is not None and number < 1:
            raise InputError(f"{name}: is {number}, expected a whole number >= 1")
    if config.report is not None:
        require_report()


def chosen_suite(config: RegressConfig, suite: Suite) -> Suite:
    """The suite with the options' cases and seeds.

    Raises:
        InputError: naming the option.
    """
    cases = tuple(case for case in suite.cases if config.only is None or config.only in case.name)
    if not cases:
        names = ", ".join(case.name for case in suite.cases)
        raise InputError(f"--only: is '{config.only}', expected part of one of the suite's cases: {names}")
    margins = suite.margins
    if config.margins and margins is None:
        raise InputError(f"--margins: the suite '{suite.name}' has no margins to measure")
    if margins is not None:
        left = tuple(name for name in margins.cases if name in {case.name for case in cases})
        margins = replace(margins, cases=left)
    chosen = replace(
        suite,
        cases=cases,
        margins=margins,
        seeds=suite.seeds if config.seeds is None else config.seeds,
        first_seed=suite.first_seed if config.first_seed is None else config.first_seed,
    )
    for problem in suite_problems(chosen):
        place, _, text = problem.partition(": ")
        raise InputError(f"--{place.replace('_', '-')}: {text}")
    return chosen
