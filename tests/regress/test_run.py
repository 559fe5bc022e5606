"""`regress` from its command line and from Python: verdicts as exit statuses, files, and refusals."""

import re
import shutil
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from regress_runs import SAMPLE, SHORT, changed_copy, yaml_suite

from humanoid_sim import run_suite
from humanoid_sim.cli import run_program
from humanoid_sim.regress import main
from humanoid_sim.regress.results import Results


@pytest.fixture
def suite(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    return str(yaml_suite(tmp_path))


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """What is stored of the sample policy, beside its suite."""
    folder = tmp_path_factory.mktemp("base")
    assert main(["lite_tracking", "--suite", str(yaml_suite(folder)), "--json", str(folder / "base.json")]) == 0
    return folder / "base.json"


def read(path):
    return msgspec.json.decode(path.read_bytes(), type=Results)


def test_the_sample_policy_passes_against_itself(suite, base, tmp_path, capsys):
    out, junit = tmp_path / "out.json", tmp_path / "out.xml"
    arguments = ["lite_tracking", "--suite", suite, "--baseline", str(base), "--json", str(out), "--junit", str(junit)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "PASS lite_tracking\n" in printed
    assert printed.count("no difference seen") == 4
    found = read(out)
    assert found.candidates[0].run.episodes == found.baseline.episodes, "the same seeds, the same bits"
    assert [seen.low for seen in found.candidates[0].comparisons] == [0.0] * 4
    assert ElementTree.parse(junit).find("testsuite").attrib["failures"] == "0"
    assert main([*arguments, "--overwrite"]) == 0
    assert read(out) == found


def test_policies_of_one_file_name_are_shown_by_their_paths(suite, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for run in ("old", "run1", "run2"):
        (tmp_path / run).mkdir()
        shutil.copy(SAMPLE, tmp_path / run / "policy.onnx")
    outputs = ["--json", "out.json", "--junit", "out.xml", "--report", "out.html"]
    arguments = ["run1/policy.onnx", "run2/policy.onnx", "lite_tracking", "--baseline", "old/policy.onnx", *outputs]
    assert main([*arguments, "--suite", suite, "--only", "drum"]) == 0
    names = ["run1/policy.onnx", "run2/policy.onnx", "lite_tracking"]
    printed, page = capsys.readouterr().out, (tmp_path / "out.html").read_text()
    for text in ("baseline old/policy.onnx: ", *(f"PASS {name}\n" for name in names)):
        assert text in printed
        assert text in page
    found = read(tmp_path / "out.json")
    assert found.baseline.name == "old/policy.onnx"
    assert [candidate.run.name for candidate in found.candidates] == names
    assert [shown.attrib["name"] for shown in ElementTree.parse("out.xml").getroot()] == names


def test_without_a_baseline_figures_are_shown_and_nothing_is_judged(suite, capsys):
    assert main([str(SAMPLE), "--suite", suite, "--only", "drum", "--seeds", "2"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("not compared") == 4
    assert re.search(r"body_position_error .* mm", printed)
    assert "0 of 2 episodes failed" in printed


def test_policies_that_are_worse_or_fail_do_not_pass_beside_one_that_does(suite, base, tmp_path, capsys):
    order = np.array([1, 0, *range(2, 14)])  # of the action's values
    worse = changed_copy(tmp_path / "swapped.onnx", "Gather", order, axis=1)
    broken = changed_copy(tmp_path / "nan.onnx", "Add", np.array([np.nan], dtype=np.float32))
    junit, page = tmp_path / "out.xml", tmp_path / "out.html"
    options = ["--suite", suite, "--baseline", str(base), "--junit", str(junit), "--report", str(page)]
    assert main(["lite_tracking", str(worse), str(broken), *options]) == 1
    printed = capsys.readouterr().out
    assert printed.index("PASS lite_tracking\n") < printed.index("FAIL swapped\n") < printed.index("FAIL nan\n")
    assert re.search(r"body_position_error +│ worse beyond tolerance ", printed)
    assert "12 of 12 episodes failed" in printed
    assert "wave, seed 0, after 0.00 s: action of left_shoulder_pitch is nan" in printed
    suites = [*ElementTree.parse(junit).getroot()]
    assert [found.attrib["tests"] for found in suites] == ["4"] * 3
    assert [found.attrib["failures"] for found in suites[::2]] == ["0", "3"]  # two errors that none has, and faults
    named = {case.attrib["name"]: case.find("failure") for case in suites[1].iter("testcase")}
    assert "worse beyond tolerance: +" in named["body_position_error"].attrib["message"]
    assert named["faults"] is None
    text = page.read_text()
    assert "worse beyond tolerance" in text
    assert not re.search("<(script|link|img)", text), "one file, without network"


def test_a_baseline_of_other_versions_is_noted_and_one_step_has_no_rate(base, tmp_path, capsys):
    made = read(base).candidates[0].run.versions["mujoco"]
    old = tmp_path / "old.json"
    old.write_text(base.read_text().replace(f'"mujoco": "{made}"', '"mujoco": "3.2.0"'))
    suite = str(yaml_suite(tmp_path))
    assert main([str(SAMPLE), "--suite", suite, "--baseline", str(old), "--only", "drum"]) == 0
    assert f"note: the baseline was made with mujoco 3.2.0, now {made}\n" in capsys.readouterr().out
    brief = str(yaml_suite(tmp_path, SHORT.replace("duration: 0.1", "duration: 0.001")))
    assert main([str(SAMPLE), "--suite", brief, "--only", "drum", "--json", str(tmp_path / "brief.json")]) == 0
    metrics = read(tmp_path / "brief.json").candidates[0].run.episodes[0].metrics
    assert (metrics["action_rate"], metrics["survival"]) == (None, 1.0)


def test_python_gives_the_same_verdict(suite, base):
    found = run_suite(SAMPLE, base, suite=suite, only="drum")
    assert found.passed
    assert "PASS lite_tracking" in str(found)
    assert found.results.candidates[0].comparisons[0].verdict == "no difference seen"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--json", "out.txt"), "--json: is 'out.txt', expected a name that ends in .json"),
        (("--only", "jump"), "--only: is 'jump', expected part of one of the suite's cases: wave, drum"),
        (("--seeds", "5", "--baseline", SAMPLE), "--seeds: is 5, expected at least 1, and 6 with a --baseline"),
        (("--baseline", "there.json"), "there.json: is not a file of `regress --json`"),
        (("--baseline", "empty.json"), "empty.json: is not a file of `regress --json`"),
    ],
)
def test_options_that_cannot_be_used_are_one_line(suite, base, options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.json").write_text("{}")
    (tmp_path / "empty.json").write_text(base.read_text().split('"candidates"')[0] + '"candidates": []}')
    assert run_program(main, [str(SAMPLE), "--suite", suite, *map(str, options)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {message}")


@pytest.mark.parametrize(
    ("before", "after", "options", "reason"),
    [
        ("mass: [0.9", "mass: [0.8", (), "its conditions differ"),
        ("name: wave", "name: circle", (), "it has 0 of 6 seeds"),
        ("", "", ("--seeds", "7"), "it has 6 of 7 seeds"),
    ],
)
def test_a_baseline_of_another_suite_or_with_fewer_seeds_is_refused(
    before, after, options, reason, base, tmp_path, capsys
):
    suite = yaml_suite(tmp_path, SHORT.replace(before, after))
    assert run_program(main, [str(SAMPLE), "--suite", str(suite), "--baseline", str(base), *options]) == 2
    error = capsys.readouterr().err
    assert f"{base}: is no baseline for case '" in error
    assert reason in error
