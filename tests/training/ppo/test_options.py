"""What `train` refuses, in one line, before anything is trained or written."""

import re
import sys

import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.envs.tasks import TASKS
from humanoid_sim.training import main
from humanoid_sim.training.ppo.learner import ALGORITHMS
from humanoid_sim.training.ppo.run import seed_of


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (
            ["--task", "trackin"],
            "--task: unknown task 'trackin' (did you mean 'tracking'?); known: auto, tracking, ",
        ),
        (
            ["--task", "dance"],
            f"--task: unknown task 'dance'; known: auto, {', '.join(TASKS)}; or a "
            "class of your own, FILE.py:NAME or MODULE:NAME\n",
        ),
        (
            ["--algorithm", "sb3-ppo"],
            "--algorithm: unknown algorithm 'sb3-ppo' (did you mean 'ppo-sb3'?); known: ppo-sb3, ppo-rsl_rl",
        ),
        (["--algorithm", "PPO_RSL"], "(did you mean 'ppo-rsl_rl'?)"),
        (["--robot", "lite_bipd"], "unknown robot 'lite_bipd' (did you mean 'lite_biped'?); known: lite, lite_biped"),
        (["--task", "piano"], "--task: piano needs a motion with target_keys, and the policy's has none"),
        (["--robot", "lite_piano", "--motion", "twinkel"], "--motion: unknown motion 'twinkel'"),
        (["--robot", "lite_piano", "--motion", "twinkle", "--motion", "wave"], "is a motion for task_type tracking"),
        (["--task", "velocity"], "lite: has a fixed base, expected a floating one, to walk with"),
        (["--robot", "lite_biped", "--task", "tracking"], "task: tracking needs a motion with motion_body_pos_b"),
        (["--robot", "lite_biped", "--motion", "wave"], "follows no motion"),
        (["--contract", "no.yaml"], "no.yaml: no such file"),
        (["--motion", "waltz"], "--motion: unknown motion 'waltz'; known: circle, "),
        (["--motion", "wave", "--motion", "wafe"], "unknown motion 'wafe' (did you mean 'wave'?)"),
        (["--reference-start", "1.5"], "--reference-start: is 1.5, expected a number from 0 to 1"),
        (["--robot", "lite_biped", "--reference-start", "0.5"], "--reference-start: is 0.5, but the policy follows no"),
        (["--terrain", "step"], "--terrain: unknown kind 'step' (did you mean 'steps'?); known: flat, rough, slopes, "),
        (["--terrain", "rough"], "--terrain: is rough, and 'lite' has a fixed base, expected flat"),
        (["--terain", "rough"], "unknown option '--terain' (did you mean '--terrain'?)"),
        (["--curriculum", "no.yaml"], "no.yaml: no such file"),
        (["--curriculum-steps", "5"], "--curriculum-steps: is 5 without --curriculum, expected both"),
        (["--curriculum-steps", "0"], "--curriculum-steps: is 0, expected at least 1"),
        (["--task", "own.py:Mine"], "--task: 'own.py': no such file"),
        (["--algorithm", "ppo-rsl_rl", "--privileged", "speed"], "--privileged: unknown "),
        (["--randomisation", "no.yaml"], "no.yaml: no such file"),
        (["--steps", "0"], "--steps: is 0, expected at least 1"),
        (["--robots", "0"], "--robots: is 0, expected at least 1"),
        (["--threads", "0"], "--threads: is 0, expected at least 1"),
        (["--seed", "-1"], "--seed: is -1, expected at least 0"),
        (["--minutes", "0"], "--minutes: is 0, expected a number > 0"),
        (["--checkpoint-seconds", "inf"], "--checkpoint-seconds: is inf, expected a number > 0"),
        (["--video-minutes", "nan"], "--video-minutes: is nan, expected a number > 0"),
        (["--output", "policy.txt"], "--output: is 'policy.txt', expected a name that ends in .onnx"),
        (["--output", "no/where.onnx"], "--output: the folder 'no' does not exist"),
        (["--privileged", "joint_torque"], "--privileged: stable-baselines3's critic sees what the policy sees"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(options, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run_program(main, ["train", *options]) == 2
    (line,) = capsys.readouterr().err.splitlines(keepends=True)
    assert line.startswith("error: ")
    assert expected in line
    assert list(tmp_path.iterdir()) == []


def test_a_bad_randomisation_names_its_file(tmp_path, capsys):
    file = tmp_path / "spread.yaml"
    file.write_text("weight: [0.9, 1.1]\n")
    assert run_program(main, ["train", "--randomisation", str(file)]) == 2
    assert f"{file}: randomisation: unknown field 'weight'; known: mass, " in capsys.readouterr().err


def test_a_training_that_goes_on_draws_other_numbers():
    assert seed_of(7, 0) == 7
    assert seed_of(7, 12) == seed_of(7, 12)
    assert len({seed_of(7, 0), seed_of(7, 12), seed_of(7, 13), seed_of(8, 12)}) == 4


def test_help_names_every_task_and_algorithm(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["train", "--help"])
    assert ended.value.code == 0
    words = re.findall(r"[\w-]+", re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out))
    assert {*TASKS, *ALGORITHMS} <= set(words)


@pytest.mark.parametrize(
    ("algorithm", "missing", "module"), [("ppo-sb3", "stable_baselines3", "sb3"), ("ppo-rsl_rl", "rsl_rl", "rsl")]
)
def test_a_missing_library_says_what_to_install(algorithm, missing, module, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name == missing or name.startswith(f"{missing}.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    for name in (
        f"humanoid_sim.training.ppo.{module}",
        "humanoid_sim.envs.stable_baselines",
        "humanoid_sim.envs.rsl_rl",
    ):
        monkeypatch.delitem(sys.modules, name, raising=False)
    assert run_program(main, ["train", "--algorithm", algorithm]) == 2
    assert "pip install 'humanoid_sim[rl]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
