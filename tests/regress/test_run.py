"""`regress` from its command line and from Python: verdicts as exit statuses, files, and refusals."""

import json
import re
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from regress_runs import SAMPLE, SHORT, changed_copy, swapped_copy, yaml_suite

from humanoid_sim import run_suite
from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.regress import main
from humanoid_sim.regress.results import Results


@pytest.fixture
def suite(tmp_path):
    return str(yaml_suite(tmp_path))


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A stored baseline of the sample policy, beside its suite."""
    folder = tmp_path_factory.mktemp("base")
    main([str(SAMPLE), "--suite", str(yaml_suite(folder)), "--write-baseline", str(folder / "base.json")])
    return folder / "base.json"


def test_the_sample_policy_passes_against_itself(suite, base, tmp_path, capsys):
    out, junit = tmp_path / "out.json", tmp_path / "out.xml"
    arguments = [str(SAMPLE), "--suite", suite, "--baseline", str(base), "--json", str(out), "--junit", str(junit)]
    assert main(arguments) == 0
    metrics = "body_position_error, joint_error, losses, faults"
    assert capsys.readouterr().out == f"PASS lite_tracking\n  no difference seen: {metrics}\n"
    found = msgspec.json.decode(out.read_bytes(), type=Results)
    assert found.candidates[0].run.episodes == found.baseline.episodes, "the same seeds, the same bits"
    assert [c["low"] for c in json.loads(out.read_bytes())["candidates"][0]["comparisons"]] == [0.0] * 4
    assert ElementTree.parse(junit).find("testsuite").attrib["failures"] == "0"
    assert main([*arguments, "--overwrite"]) == 0
    assert msgspec.json.decode(out.read_bytes(), type=Results) == found


def test_without_a_baseline_figures_are_shown_and_nothing_is_judged(suite, capsys):
    assert main([str(SAMPLE), "--suite", suite, "--only", "drum", "--seeds", "2"]) == 0
    first, *figures = capsys.readouterr().out.splitlines()
    assert first == "lite_tracking: 2 episodes, 0 failed; no baseline to compare with"
    assert [line.split()[0] for line in figures] == ["body_position_error", "joint_error", "losses", "faults"]


def test_a_policy_that_is_worse_fails_beside_one_that_is_not(suite, base, tmp_path, capsys):
    worse = swapped_copy(SAMPLE, tmp_path / "swapped.onnx")
    junit, page = tmp_path / "out.xml", tmp_path / "out.html"
    outputs = ["--junit", str(junit), "--report", str(page)]
    assert main([str(SAMPLE), str(worse), "--suite", suite, "--baseline", str(base), *outputs]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert (lines[0], lines[2]) == ("PASS lite_tracking", "FAIL swapped")
    assert lines[3].startswith("  worse beyond tolerance: body_position_error +")
    assert lines[4] == "  no difference seen: losses, faults"
    passed, failed = ElementTree.parse(junit).getroot()
    assert (passed.attrib["tests"], passed.attrib["failures"]) == ("4", "0")
    assert (failed.attrib["tests"], failed.attrib["failures"]) == ("4", "2")
    named = {case.attrib["name"]: case.find("failure") for case in failed.iter("testcase")}
    assert "worse beyond tolerance: +" in named["joint_error"].attrib["message"]
    assert named["faults"] is None
    text = page.read_text()
    assert "<td>swapped</td><td>body_position_error</td><td>worse beyond tolerance</td>" in text
    assert not re.search("<(script|link|img)", text), "one file, without network"


def test_failing_episodes_are_counted_with_their_reason(suite, base, tmp_path, capsys):
    policy = changed_copy(SAMPLE, tmp_path / "nan.onnx", "Add", np.array([np.nan], dtype=np.float32))
    junit = tmp_path / "out.xml"
    assert main([str(policy), "--suite", suite, "--baseline", str(base), "--junit", str(junit)]) == 1
    printed = capsys.readouterr().out
    assert "12 of 12 episodes failed (the baseline: 0 of 12):" in printed
    assert "12 new, such as wave, seed 0" in printed
    assert ElementTree.parse(junit).find("testsuite").attrib["failures"] == "3"  # two errors that none has, and faults


def test_python_gives_the_same_verdict_and_a_frame(suite, base):
    found = run_suite(SAMPLE, base, suite=suite, only="drum")
    assert found.passed
    assert "PASS lite_tracking" in str(found)
    assert list(found.frame()["policy"]) == ["lite_tracking"] * 12
    assert found.results.candidates[0].comparisons[0].verdict == "no difference seen"


def complaint(capsys, *arguments):
    """The one line on stderr of a program that ends with status 2."""
    assert run_program(main, [str(argument) for argument in arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line.removeprefix("error: ")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--json", "out.txt"), "--json: is 'out.txt', expected a name that ends in .json"),
        (("--junit", "no/where.xml"), "--junit: the folder 'no' does not exist"),
        (("--only", "jump"), "--only: is 'jump', expected part of one of the suite's cases: wave, drum"),
        (("--seeds", "5", "--baseline", SAMPLE), "--seeds: is 5, expected at least 1, and 6 with a --baseline"),
        (("--baseline", "there.json"), "there.json: is not a baseline of `regress --write-baseline`"),
        (("--ray", "127.0.0.1:1"), "--ray: is '127.0.0.1:1', and nobody answers there"),
    ],
)
def test_options_that_cannot_be_used_are_one_line(suite, options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.json").write_text("{}")
    assert complaint(capsys, SAMPLE, "--suite", suite, *options).startswith(message)


def without(name):
    def change(document):
        for entry in document["episodes"]:
            del entry["metrics"][name]

    return change


@pytest.mark.parametrize(
    ("change", "text", "options", "message"),
    [
        (None, ("mass: [0.9", "mass: [0.8"), (), "its case 'wave' was run under other conditions"),
        (None, ("name: wave", "name: circle"), (), "unknown case 'circle'; known: wave, drum"),
        (None, ("", ""), ("--seeds", "7"), "has the seeds 0 to 5; see --seeds"),
        (without("joint_error"), ("", ""), (), "was made before joint_error could be measured"),
    ],
)
def test_a_baseline_that_does_not_fit_is_refused(change, text, options, message, base, tmp_path, capsys):
    document = json.loads(base.read_bytes())
    if change is not None:
        change(document)
    path = tmp_path / "base.json"
    path.write_text(json.dumps(document))
    suite = yaml_suite(tmp_path, SHORT.replace(*text))
    line = complaint(capsys, SAMPLE, "--suite", suite, "--baseline", path, *options)
    assert line.startswith(f"{path}: ")
    assert message in line


def test_policies_with_one_name_are_called_by_their_paths(suite, tmp_path, capsys):
    paths = [tmp_path / folder / "policy.onnx" for folder in "ab"]
    for path in paths:
        path.parent.mkdir()
        path.write_bytes(asset_path("policies", "lite_tracking.onnx").read_bytes())
    assert main([*map(str, paths), "--suite", suite, "--only", "drum", "--seeds", "1"]) == 0
    named = [line.split(":")[0] for line in capsys.readouterr().out.splitlines() if "episodes" in line]
    assert named == [str(path) for path in paths]
