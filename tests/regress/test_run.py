"""`regress` from its command line: verdicts as exit statuses, outputs, and one line for what cannot be used."""

import json
import re
from xml.etree import ElementTree

import msgspec
import pytest
from policies import SAMPLE, failing_copy, swapped_copy
from regress_runs import SHORT, standing_policy, yaml_suite

from humanoid_sim.assets import WALKING_POLICY, asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.regress import main
from humanoid_sim.regress.results import Results
from humanoid_sim.replay import main as replay

# What only the option `suite` changes from test to test is left as short as it can be.
ONE = SHORT.replace("  - {name: drum, motion: drum, duration: 0.3}\n", "").replace("duration: 0.4", "duration: 0.2")


@pytest.fixture
def suite(tmp_path):
    return str(yaml_suite(tmp_path, ONE))


def results(path):
    return msgspec.json.decode(path.read_bytes(), type=Results)


def test_the_sample_policy_passes_against_itself(suite, tmp_path, capsys):
    base, out, junit = tmp_path / "base.json", tmp_path / "out.json", tmp_path / "out.xml"
    assert main([str(SAMPLE), "--suite", suite, "--write-baseline", str(base)]) == 0
    assert "lite_tracking: 3 episodes, 0 failed; no baseline to compare with" in capsys.readouterr().out
    arguments = [str(SAMPLE), "--suite", suite, "--baseline", str(base), "--json", str(out), "--junit", str(junit)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert printed.index("against the baseline") < printed.index("PASS")
    metrics = "body_position_error, joint_error, losses, faults"
    assert printed.splitlines()[-1] == f"PASS lite_tracking: no difference seen: {metrics}"
    found = results(out)
    assert found.passed
    assert found.candidates[0].run.episodes == found.baseline.episodes
    assert {comparison.verdict for comparison in found.candidates[0].comparisons} == {"no difference seen"}
    assert ElementTree.parse(junit).getroot().get("failures") == "0"


def test_the_same_command_writes_the_same_bytes(suite, tmp_path):
    for name in ("one.json", "two.json"):
        main([str(SAMPLE), "--suite", suite, "--json", str(tmp_path / name), "--quiet"])
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()


def test_a_policy_that_is_worse_fails_and_is_named_beside_one_that_is_not(suite, tmp_path, capsys):
    worse = swapped_copy(SAMPLE, tmp_path / "swapped.onnx", 0, 1)
    assert main([str(SAMPLE), str(worse), "--suite", suite, "--baseline", str(SAMPLE), "--quiet"]) == 1
    passed, failed, same = capsys.readouterr().out.splitlines()
    assert passed.startswith("PASS lite_tracking: no difference seen: body_position_error, ")
    number = r"\+[\d.]+"
    metrics = (rf"{name} {number} % \({number} to {number} %\)" for name in ("body_position_error", "joint_error"))
    assert re.fullmatch(f"FAIL swapped: worse beyond tolerance: {', '.join(metrics)}", failed)
    assert same == "  no difference seen: losses, faults"


def test_actions_that_are_no_number_fail_the_episodes_and_not_the_run(suite, tmp_path, capsys):
    policy = failing_copy(SAMPLE, tmp_path / "nan.onnx")
    folder = tmp_path / "failures"
    arguments = [str(policy), "--suite", suite, "--baseline", str(SAMPLE), "--record-failures", str(folder)]
    assert main([*arguments, "--record-limit", "2"]) == 1
    printed = capsys.readouterr().out
    assert "3 of 3 episodes failed (the baseline: 0 of 3):" in printed
    assert "without 3 of 3 pairs in which an episode failed: body_position_error, joint_error" in printed
    assert "wave, seed 0, after 0.00 s: action of left_shoulder_pitch is nan, expected a magnitude <= 100" in printed
    lines = printed.splitlines()
    assert "FAIL nan: lost: body_position_error, joint_error" in lines
    new = "3 new: wave, seed 0; wave, seed 1; wave, seed 2"
    assert f"  worse beyond tolerance: faults +100 % (+100 to +100 %; {new})" in lines
    again = f"regress {policy} --suite {suite} --episode wave:0"
    assert f"joint by joint: {again}; then replay its recording with --policy {SAMPLE}" in lines
    assert sorted(path.name for path in folder.iterdir()) == ["nan-wave-0.mcap", "nan-wave-1.mcap"]


def test_other_seeds_are_compared_case_by_case(suite, tmp_path, capsys):
    base = tmp_path / "base.json"
    main([str(SAMPLE), "--suite", suite, "--write-baseline", str(base), "--quiet"])
    assert main([str(SAMPLE), "--suite", suite, "--baseline", str(base), "--first-seed", "50"]) == 1, "undecided"
    assert "other seeds than the baseline's: compared case by case, not pair by pair" in capsys.readouterr().out


def test_two_seeds_that_cannot_judge_are_undecided_and_no_pass(suite, tmp_path, capsys):
    base = tmp_path / "base.json"
    main([str(SAMPLE), "--suite", suite, "--write-baseline", str(base), "--quiet", "--seeds", "2"])
    arguments = [str(SAMPLE), "--suite", suite, "--baseline", str(base), "--first-seed", "50", "--seeds", "2"]
    assert main(arguments) == 1
    undecided, unclear, _ = capsys.readouterr().out.splitlines()[-3:]
    assert undecided == (
        "UNDECIDED lite_tracking: 2 seeds are too few to judge body_position_error, joint_error; 6 or more are expected"
    )
    assert unclear.startswith("  unclear: body_position_error ")


def test_one_episode_is_run_and_recorded_whether_it_fails_or_not(suite, tmp_path, capsys):
    folder = tmp_path / "one"
    assert (
        main([str(SAMPLE), "--suite", suite, "--episode", "wave:7", "--record-failures", str(folder), "--quiet"]) == 0
    )
    (path,) = folder.iterdir()
    assert path.name == "lite_tracking-wave-7.mcap"
    assert capsys.readouterr().out == f"recorded {path}\n"
    assert replay([str(path)]) == 0


def complaint(capsys, *arguments):
    """The one line on stderr of a program that ends with status 2."""
    assert run_program(main, arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line.removeprefix("error: ")


def test_options_that_cannot_be(suite, tmp_path, capsys):
    there = tmp_path / "there.json"
    there.write_text("{}")
    policy, short = str(SAMPLE), ("--suite", suite)
    for arguments, expected in (
        (short, "POLICIES: is empty, expected one or more ONNX checkpoints"),
        ((policy, "--suite", "nowhere"), "--suite: unknown suite 'nowhere'; known: lite_piano, lite_tracking"),
        ((policy, *short, "--json", "out.txt"), "--json: is 'out.txt', expected a name that ends in .json"),
        ((policy, *short, "--json", str(there)), f"--json: '{there}' exists; choose another name, or add --overwrite"),
        ((policy, *short, "--junit", "no/where.xml"), "--junit: the folder 'no' does not exist"),
        ((policy, *short, "--json", "/proc/out.json"), "--json: '/proc/out.json' cannot be written: "),
        ((policy, *short, "--only", "jump"), "--only: is 'jump', expected part of one of the suite's cases: wave"),
        ((policy, *short, "--seeds", "1"), "--seeds: is 1, expected at least 2"),
        ((policy, *short, "--episode", "wave"), "--episode: is 'wave', expected CASE:SEED, such as wave:3"),
        ((policy, *short, "--episode", "jump:1"), "--episode: unknown case 'jump'; known: wave"),
        (
            (policy, *short, "--episode", "wave:2147483648"),
            "--episode: the seed is 2147483648, expected 0 to 2147483647",
        ),
        (
            (policy, *short, "--episode", "wave:1", "--baseline", policy),
            "--baseline: has no effect with --episode, which judges nothing; leave one out",
        ),
        ((policy, *short, "--threads", "0"), "--threads: is 0, expected a whole number >= 1"),
        (
            (policy, *short, "--record-failures", str(there)),
            f"--record-failures: '{there}' is a file, expected a folder",
        ),
        ((policy, "--suite", "velocity"), "--robot: is missing; the suite 'velocity' is for any robot and names none"),
        ((policy, *short, "--baseline", str(there)), f"{there}: is not a baseline of `regress --write-baseline`"),
        ((str(tmp_path / "none.onnx"), *short), f"{tmp_path / 'none.onnx'}: no such file, expected an ONNX file"),
    ):
        assert complaint(capsys, *arguments).startswith(expected)


def test_policies_and_baselines_that_do_not_fit(suite, tmp_path, capsys):
    walker = standing_policy(tmp_path / "walker.onnx")
    line = complaint(capsys, str(walker), "--suite", suite, "--robot", "lite_biped")
    assert line == (
        f"{walker}: is a policy for task_type locomotion, the suite 'short' is for a policy that follows motions; "
        "use --suite velocity --robot lite_biped"
    )
    line = complaint(capsys, str(SAMPLE), "--suite", "velocity", "--robot", "lite")
    assert line == "robot 'lite': has a fixed base, a velocity suite expects a floating one"
    pushed = yaml_suite(tmp_path, ONE + "pushes: {speed: 0.5}\n")
    line = complaint(capsys, str(SAMPLE), "--suite", str(pushed))
    assert line == "robot 'lite': has a fixed base, which the suite's pushes would not move"
    yaml_suite(tmp_path, ONE)
    line = complaint(capsys, str(SAMPLE), "--suite", suite, "--robot", "lite_neck")
    assert line.startswith(f"{SAMPLE}: ")
    assert "the policy lacks neck_yaw, neck_roll, neck_pitch" in line
    base = tmp_path / "base.json"
    main([str(SAMPLE), "--suite", suite, "--write-baseline", str(base), "--quiet"])
    capsys.readouterr()
    other = yaml_suite(tmp_path, ONE.replace("mass: [0.9, 1.1]", "mass: [0.8, 1.2]"))
    line = complaint(capsys, str(SAMPLE), "--suite", str(other), "--baseline", str(base))
    remade = f"python -m humanoid_sim.regress {SAMPLE} --suite {{}} --write-baseline {base} --overwrite"
    assert line.startswith(f"{base}: its case 'wave' was run under other conditions")
    assert line.endswith(f"; make it again: {remade.format(other)}")
    today = base.read_text()
    older = json.loads(today)
    older["definitions"]["fall"] = "the base's frame is below 0.6 of its height"
    base.write_text(json.dumps(older))
    line = complaint(capsys, str(SAMPLE), "--suite", suite, "--seeds", "2", "--baseline", str(base))
    again = remade.format(f"{suite} --seeds 2")
    assert line == (
        f"{base}: was made with other definitions than today's (fall), so its figures cannot be compared; "
        f"make it again: {again}"
    )
    del older["definitions"]
    base.write_text(json.dumps(older))
    line = complaint(capsys, str(SAMPLE), "--suite", suite, "--baseline", str(base))
    assert "(fall, loss, errors)" in line
    base.write_text(today)
    other = yaml_suite(tmp_path, ONE.replace("name: wave", "name: circle"))
    line = complaint(capsys, str(SAMPLE), "--suite", str(other), "--baseline", str(base))
    assert line == f"{base}: unknown case 'circle'; known: wave"


def test_a_baseline_made_before_a_metric_was_is_no_baseline_for_it(tmp_path, capsys):
    older = json.loads(asset_path("suites", "velocity.lite_biped.json").read_bytes())
    for episode in older["episodes"]:
        del episode["metrics"]["vx_reached"], episode["metrics"]["vy_reached"]
    old = tmp_path / "old.json"
    old.write_text(json.dumps(older))
    arguments = (str(WALKING_POLICY), "--suite", "velocity", "--robot", "lite_biped", "--baseline", str(old))
    line = complaint(capsys, *arguments)
    assert line == (
        f"{old}: was made before vx_reached, vy_reached could be measured, which the suite judges; make it again: "
        "python -m humanoid_sim.regress assets/policies/lite_biped_velocity.onnx --suite velocity --robot lite_biped "
        f"--write-baseline {old} --overwrite"
    )
    assert "made before vx_reached could" in complaint(capsys, *arguments, "--only", "forward")


def test_a_policy_is_compared_with_itself_across_plants(suite, tmp_path):
    """What the implicit plant changes is small; a baseline stored on one plant is none for the other."""
    out, base = tmp_path / "out.json", tmp_path / "base.json"
    plants = ["--actuation", "implicit", "--baseline-actuation", "affine"]
    main([str(SAMPLE), "--suite", suite, "--baseline", str(SAMPLE), *plants, "--json", str(out)])
    assert results(out).candidates[0].worse == ()
    (comparison,) = (c for c in results(out).candidates[0].comparisons if c.metric == "body_position_error")
    assert comparison.candidate != comparison.baseline
    assert abs(comparison.candidate - comparison.baseline) < 0.001
    assert main([str(SAMPLE), "--suite", suite, "--write-baseline", str(base), "--quiet"]) == 0
    with pytest.raises(InputError, match="was run under other conditions"):
        main([str(SAMPLE), "--suite", suite, "--baseline", str(base), "--actuation", "implicit", "--quiet"])
    with pytest.raises(InputError, match=r"^--baseline-actuation: --baseline is '.*base.json', expected a checkpoint"):
        main([str(SAMPLE), "--suite", suite, "--baseline", str(base), "--baseline-actuation", "implicit"])
    with pytest.raises(InputError, match=r"^--baseline-actuation: no --baseline is given, expected a checkpoint"):
        main([str(SAMPLE), "--suite", suite, "--baseline-actuation", "implicit"])
