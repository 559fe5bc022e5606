"""Fixtures of the tests of policies: a checkpoint, its trainer's trace, and the program to run on them."""

from typing import Any

import pytest
from trainer import MJCF, Run, save_checkpoint, save_trace

from humanoid_sim.cli import run_program
from humanoid_sim.policy.findings import Finding
from humanoid_sim.policy_tools import main
from humanoid_sim.robots.description import load_robot

__all__ = ["cli", "robot", "stamped", "trace", "walker"]


def found(findings: Any, line: str) -> Finding:
    """The one finding of `severity field: words of its message`."""
    start, _, words = line.partition(": ")
    hits = [one for one in findings if f"{one.severity} {one.field}" == start and words in one.message]
    assert len(hits) == 1, "\n".join(f"{one.severity} {one}" for one in findings)
    return hits[0]


@pytest.fixture
def cli(capsys, monkeypatch):
    """Runs `policy` with arguments; returns exit status, standard output and standard error."""
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments):
        try:
            status = run_program(main, [str(argument) for argument in arguments])
        except SystemExit as error:
            status = int(error.code or 0)
        output = capsys.readouterr()
        return status, output.out, output.err

    return run


@pytest.fixture
def walker(tmp_path):
    """A checkpoint that walks, as its trainer exports it; `trainer` says how it is wired."""
    return save_checkpoint(tmp_path / "walker.onnx")


@pytest.fixture
def trace(tmp_path):
    """A run of `walker` in its trainer's own program."""
    return save_trace(tmp_path / "trace.npz", Run())


@pytest.fixture
def stamped(cli, walker, trace, robot, tmp_path):
    """`walker` with golden vectors of its trainer's run, in a folder of its own."""
    output = tmp_path / "stamped" / "walker.onnx"
    output.parent.mkdir()
    status, _, error = cli("stamp", walker, "-o", output, "--trace", trace, "--robot", robot.mjcf_path)
    assert status == 0, error
    return output


@pytest.fixture(scope="session")
def robot(tmp_path_factory):
    """The robot that the trainer's policy is for."""
    path = tmp_path_factory.mktemp("robot") / "walker.xml"
    path.write_text(MJCF, encoding="utf-8")
    return load_robot(str(path))
