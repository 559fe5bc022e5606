"""What becomes of the options: arguments of the environments, and what a folder keeps of them."""

import inspect
import json
from dataclasses import fields
from pathlib import Path

import pytest

from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError
from humanoid_sim.simulation.terrain import Terrain
from humanoid_sim.training.ppo.environment import ARGUMENTS, ONLY_TRAINED, arguments_of, as_options
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
