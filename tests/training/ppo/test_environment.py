"""What becomes of the options: arguments of the environments, what is trained, and what a folder keeps of them."""

import inspect
import json
import math
from dataclasses import fields
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from humanoid_sim.assets import motion_path
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.simulation.terrain import Terrain
from humanoid_sim.training.ppo.environment import (
    ARGUMENTS,
    ONLY_TRAINED,
    arguments_of,
    as_options,
    own_object,
    subject_of,
)
from humanoid_sim.training.ppo.export import motion_file
from humanoid_sim.training.ppo.learner import first_spread
from humanoid_sim.training.ppo.options import TrainConfig

EXAMPLES = Path(__file__).parents[3] / "examples"


def argument(name, **options):
    return arguments_of(TrainConfig(**options))[name]


def test_every_argument_is_an_option_and_one_of_the_environments():
    assert set(ARGUMENTS) <= {field.name for field in fields(TrainConfig)}
    accepted = {name for kind in (PolicyVectorEnv, make_scenario) for name in inspect.signature(kind).parameters}
    assert set(ARGUMENTS) <= accepted
    assert set(ONLY_TRAINED) <= set(inspect.signature(PolicyEnv).parameters) & set(ARGUMENTS)


def test_what_is_kept_is_plain_and_says_what_files_said(tmp_path):
    ground, spread, harder = (tmp_path / f"{name}.yaml" for name in ("ground", "spread", "harder"))
    ground.write_text("{kind: steps, step_height: 0.05}")
    spread.write_text("mass: [0.9, 1.1]")
    harder.write_text("push: [[0.5, 0], [1, 1]]")
    read = arguments_of(
        TrainConfig(
            robot="lite_biped", terrain=str(ground), randomisation=str(spread), curriculum=str(harder), steps=10
        )
    )
    assert read["terrain"].value == Terrain("steps", step_height=0.05)
    told = {name: each.told for name, each in read.items()}
    assert json.loads(json.dumps(told)) == told
    assert (told["terrain"]["kind"], told["terrain"]["step_height"], told["terrain"]["levels"]) == ("steps", 0.05, 4)
    assert told["randomisation"] == {"mass": [0.9, 1.1]}
    assert told["curriculum"] == {"push": [[0.5, 0], [1, 1]]}
    assert read["curriculum"].value(0.75) == {"push": 0.5}


def test_defaults_are_those_of_the_registered_environments():
    for robot, contract, motion in (
        ("lite", "lite_tracking", "wave"),
        ("lite_biped", "lite_biped_velocity", None),
        ("lite_piano", "lite_piano_task", "ode_to_joy"),
        ("lite_neck", "lite_tracking", "wave"),
    ):
        read = arguments_of(TrainConfig(robot=robot))
        assert (read["contract"].value, read["motion"].value) == (contract, motion)
    assert argument("motion", contract="mine.yaml").value is None
    assert argument("motion", motion=("circle",)).value == "circle"
    assert argument("motion", motion=("circle", "wave")).value == ["circle", "wave"]
    assert argument("terrain").value is None


def test_ones_own_task_and_curriculum():
    task = argument("task", task=f"{EXAMPLES / 'own_task.py'}:HoldTask")
    assert task.value.__name__ == "HoldTask"
    assert task.told.endswith("own_task.py:HoldTask")
    pytest.importorskip("stable_baselines3")  # which the example imports
    curriculum = argument("curriculum", curriculum=f"{EXAMPLES / 'growing_harder.py'}:harder")
    assert curriculum.value(0.0)["terrain"] == 0.0


OWN = """
from humanoid_sim.envs.tasks.task import Task

number = 3

class Half(Task):
    pass

def too_much(progress):
    return {"push": 2.0 * progress}

def broken(progress):
    return {"push": 1.0 / progress}
"""


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (
            {"task": "own.py:number"},
            "--task: 'own.py:number' is not a task, expected a subclass of humanoid_sim.envs.tasks",
        ),
        ({"task": "own.py:Half"}, "--task: 'own.py:Half' is not a whole task, it lacks _measure"),
        ({"task": "own.py:Hall"}, "--task: unknown name 'Hall' (did you mean 'Half'?) in 'own.py'"),
        ({"curriculum": "harder"}, "--curriculum: is 'harder', expected a YAML file, or a function: FILE.py:NAME or "),
        ({"curriculum": "own.py:number"}, "--curriculum: 'own.py:number' is not a function"),
        ({"curriculum": "own.py:too_much"}, "own.py:too_much: curriculum: push is 2.0 at the progress 1, expected a "),
        ({"curriculum": "own.py:broken"}, "--curriculum: 'own.py:broken' fails at the progress 0: ZeroDivisionError"),
        ({"curriculum": "bad.yaml"}, "bad.yaml: curriculum: unknown amount 'kind'; known: commands, terrain, "),
        ({"curriculum": "list.yaml"}, "--curriculum: 'list.yaml' has no fields, expected a mapping"),
        ({"terrain": "step"}, "--terrain: unknown kind 'step' (did you mean 'steps'?); known: flat, rough, slopes, "),
        ({"terrain": "no.yaml"}, "no.yaml: no such file"),
        ({"terrain": "bad.yaml"}, "bad.yaml: terrain: unknown field 'high'; known: kind, seed, "),
    ],
)
def test_bad_values_are_one_line(options, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(OWN)
    Path("bad.yaml").write_text("{kind: steps, high: 1}")
    Path("list.yaml").write_text("[1, 2]")
    with pytest.raises(InputError) as error:
        arguments_of(TrainConfig(**options))
    assert str(error.value).startswith(expected)


def test_what_an_environment_says_is_said_of_the_option():
    told = as_options(InputError("reference_start: is 2, expected a number from 0 to 1"))
    assert str(told) == "--reference-start: is 2, expected a number from 0 to 1"
    assert str(as_options(InputError("robot.yaml: no such file"))) == "robot.yaml: no such file"


def test_a_robot_alone_is_trained_for_what_its_policy_does():
    arms = subject_of(TrainConfig())
    assert (arms.task, arms.told["contract"], arms.told["motion"]) == ("tracking", "lite_tracking", "wave")
    legs = subject_of(TrainConfig(robot="lite_biped"))
    assert (legs.task, legs.told["contract"], legs.told["motion"]) == ("velocity", "lite_biped_velocity", None)
    assert legs.contract.phase is not None
    assert subject_of(TrainConfig(robot="lite_biped", task="walking")).task == "walking"
    # 0.2 rad of 0.5 rad per unit of action, and 0.1 rad of 0.25
    assert first_spread(arms.contract, is_floating=False) == pytest.approx(0.4)
    assert first_spread(legs.contract, is_floating=True) == pytest.approx(0.4)


def test_the_environments_are_those_of_the_options():
    envs = subject_of(TrainConfig(actuation="implicit", physics_timestep=0.005)).environments(2)
    assert (envs.scenario.actuation, envs.scenario.physics_timestep) == ("implicit", 0.005)
    assert envs.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.SAME_STEP
    plain = gymnasium.make_vec(
        "humanoid_sim/LiteTracking-v0",
        num_envs=2,
        actuation="implicit",
        physics_timestep=0.005,
        autoreset_mode="SameStep",
    )
    np.testing.assert_array_equal(envs.reset(seed=3)[0], plain.reset(seed=3)[0])
    action = np.full((2, 14), 0.1, dtype=np.float32)
    np.testing.assert_array_equal(envs.step(action)[0], plain.step(action)[0])
    envs.close()
    plain.close()


def test_what_the_critic_sees_is_rsl_rls_affair():
    subject = subject_of(TrainConfig(algorithm="ppo-rsl_rl", privileged=("joint_torque",)))
    envs = subject.environments(1)
    assert envs.reset(seed=0)[1]["privileged"].shape == (1, 14)
    envs.close()
    with pytest.raises(InputError, match=r"^--privileged: base_height is of a floating base"):
        subject_of(TrainConfig(algorithm="ppo-rsl_rl", privileged=("base_height",)))


def test_ground_motions_and_starts_reach_the_environments():
    walking = subject_of(TrainConfig(robot="lite_biped", terrain="steps"))
    assert walking.scenario.terrain is not None
    assert walking.told["terrain"]["kind"] == "steps"
    several = subject_of(TrainConfig(motion=("wave", "circle"), reference_start=0.8))
    starts = several.scenario.starts
    assert (len(starts.reference.lengths), starts.reference_start) == (2, 0.8)
    alone = several.environment()  # to be looked at: from the beginning
    assert alone.scenario.starts.reference_start == 0.0
    alone.close()


def test_a_song_is_the_motion_of_the_piano(tmp_path):
    subject = subject_of(TrainConfig(robot="lite_piano", motion=("twinkle",)))
    assert (subject.task, subject.told["motion"]) == ("piano", "twinkle")
    file = motion_file(subject.scenario.motion, tmp_path)
    assert file == tmp_path / "motion.mcap"
    song = read_motion(file)
    assert (song.task_type, song.frames.shape[1]) == ("piano", 88)
    assert len(song.frames) == subject.scenario.wiring.reference.frame_count
    arms = subject_of(TrainConfig(motion=("circle", "wave")))
    assert motion_file(arms.scenario.motion, tmp_path) == motion_path("circle")
    assert motion_file(subject_of(TrainConfig(robot="lite_biped")).scenario.motion, tmp_path) is None


def test_a_name_in_a_file_and_in_a_module(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("from dataclasses import dataclass\n\n@dataclass\nclass Mine:\n    x: int = 7\n")
    assert own_object("--task", f"{file}:Mine")().x == 7
    assert own_object("--task", "math:tau") is math.tau


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mine.py:", r"^--task: is 'mine.py:', expected FILE.py:NAME or MODULE:NAME$"),
        (":Mine", r"^--task: is ':Mine', expected FILE.py:NAME or MODULE:NAME$"),
        ("mine.py:a b", "expected FILE.py:NAME"),
        ("no.py:Mine", r"^--task: 'no.py': no such file$"),
        ("no_such_module:Mine", r"^--task: 'no_such_module' cannot be imported: no module 'no_such_module'$"),
        ("mine.py:Mime", r"^--task: unknown name 'Mime' \(did you mean 'Mine'\?\) in 'mine.py'$"),
        ("broken.py:Mine", r"^--task: 'broken.py' cannot be imported: ZeroDivisionError: division by zero$"),
        ("wrong.py:Mine", r"^--task: 'wrong.py' cannot be imported: SyntaxError: "),
        ("ends.py:Mine", r"^--task: 'ends.py' cannot be imported: SystemExit: 3$"),
    ],
)
def test_what_cannot_be_used_is_one_line(text, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, code in {
        "mine": "class Mine:\n    pass\n",
        "broken": "1 / 0\n",
        "wrong": "class\n",
        "ends": "import sys\nsys.exit(3)\n",
    }.items():
        Path(f"{name}.py").write_text(code)
    with pytest.raises(InputError, match=expected) as error:
        own_object("--task", text)
    assert "\n" not in str(error.value)
