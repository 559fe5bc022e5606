"""Options of `train` as arguments of the environments, and what a run trains: contract, robot, motion and task."""

from __future__ import annotations

import importlib
import inspect
import runpy
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs.curriculum import amounts_at, scheduled
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.privileged import Privileged
from humanoid_sim.envs.registration import ENVIRONMENTS
from humanoid_sim.envs.scenario import Scenario, checkpoint_of, make_scenario
from humanoid_sim.envs.tasks import TASKS, Task
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError, known_names, reason_of, require_known
from humanoid_sim.files import is_file
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch import Randomisation
from humanoid_sim.simulation.terrain import Terrain
from humanoid_sim.strict_yaml import read_yaml
from humanoid_sim.training.ppo.learner import ALGORITHMS
from humanoid_sim.training.ppo.options import TrainConfig

_YAML = (".yaml", ".yml")
_FORM = "FILE.py:NAME or MODULE:NAME"
_USUAL = [entry["kwargs"] for entry in ENVIRONMENTS.values() if "contract" in entry.get("kwargs", {})]
"""Arguments of the registered environments of one policy."""


class Argument(NamedTuple):
    """One argument of an environment."""

    value: Any
    told: Any
    """Plain value stored in `run.json`, so that a resumed run has the original settings even if files changed."""


def arguments_of(config: TrainConfig) -> dict[str, Argument]:
    """Return the environments' arguments by keyword.

    Raises `InputError`: one line with the option, its value and what is accepted.
    """
    found = {name: read(config) for name, read in ARGUMENTS.items()}
    return {name: one if isinstance(one, Argument) else Argument(one, one) for name, one in found.items()}


def as_options(error: InputError) -> InputError:
    """Return what an environment says about an argument, said of the option."""
    name, colon, rest = str(error).partition(":")
    return InputError(f"--{name.replace('_', '-')}:{rest}") if colon and name in ARGUMENTS else error


def _task(config: TrainConfig) -> Argument:
    text = config.task
    if ":" not in text:
        if text not in ("auto", *TASKS):
            raise InputError(f"--task: {known_names('task', text, ('auto', *TASKS))}; or a class of your own, {_FORM}")
        return Argument(text, None)  # told by what it comes to
    task = own_object("--task", text)
    if not (inspect.isclass(task) and issubclass(task, Task)):
        raise InputError(f"--task: '{text}' is not a task, expected a subclass of humanoid_sim.envs.tasks.Task")
    if inspect.isabstract(task):
        missing = ", ".join(sorted(task.__abstractmethods__))
        raise InputError(f"--task: '{text}' is not a whole task, it lacks {missing}")
    return Argument(task, text)


def _contract(config: TrainConfig) -> str:
    """Return that of the environment that is registered for the robot; of others that of the arms."""
    known = {usual["robot"]: usual["contract"] for usual in _USUAL}
    return str(config.contract or known.get(config.robot) or _USUAL[0]["contract"])


def _motion(config: TrainConfig) -> str | list[str] | None:
    """Return that of the environment for the contract, unless options name one or several."""
    if not config.motion:
        return {usual["contract"]: usual.get("motion") for usual in _USUAL}.get(_contract(config))
    return config.motion[0] if len(config.motion) == 1 else list(config.motion)


def _terrain(config: TrainConfig) -> Argument:
    given: Any = config.terrain
    if given.endswith(_YAML):
        given = _fields("--terrain", given)
    terrain = _named(config.terrain, given, Terrain.of)
    return Argument(terrain, None if terrain is None else asdict(terrain))


def _randomisation(config: TrainConfig) -> Argument:
    if config.randomisation is None:
        return Argument(Randomisation(), None)
    values = read_yaml(Path(config.randomisation))
    return Argument(_named(config.randomisation, values, Randomisation.of), values)


def _curriculum(config: TrainConfig) -> Argument:
    text = config.curriculum
    if text is None:
        return Argument(None, None)
    if text.endswith(_YAML):
        points = _fields("--curriculum", text)
        return Argument(_named(text, points, scheduled), points)
    if ":" not in text:
        raise InputError(f"--curriculum: is '{text}', expected a YAML file, or a function: {_FORM}")
    function = own_object("--curriculum", text)
    if not callable(function):
        raise InputError(f"--curriculum: '{text}' is not a function, expected one of the progress, 0 to 1")
    for progress in (0.0, 0.5, 1.0):
        try:
            amounts_at(function, progress)
        except InputError as error:
            raise InputError(f"{text}: {error}") from None
        except Exception as error:
            where = f"--curriculum: '{text}' fails at the progress {progress:g}"
            raise InputError(f"{where}: {type(error).__name__}: {error}") from None
    return Argument(function, text)


def _fields(option: str, file: str) -> Any:
    values = read_yaml(Path(file))
    if not isinstance(values, dict):
        raise InputError(f"{option}: '{file}' has no fields, expected a mapping")
    return values


def _named(text: str, values: Any, make: Callable[[Any], Any]) -> Any:
    """Return what is made of the values of a file, which a complaint names."""
    try:
        return make(values)
    except InputError as error:
        if values is text:
            raise as_options(error) from None
        raise InputError(f"{text}: {error}") from None


def own_object(option: str, text: str) -> Any:
    """Return what `text` names: `examples/own_task.py:HoldTask`, or `my_package.tasks:HoldTask`.

    Raises `InputError` if there is no such file, module or name, or it fails as it is imported.
    """
    place, _, name = text.rpartition(":")
    is_in_file = place.endswith(".py")
    if not place or not name.isidentifier():
        raise InputError(f"{option}: is '{text}', expected {_FORM}")
    if is_in_file and not is_file(Path(place)):
        raise InputError(f"{option}: '{place}': no such file")
    try:
        if is_in_file:
            known = runpy.run_path(place, run_name=f"humanoid_sim_own_{Path(place).stem}")
        else:
            known = vars(importlib.import_module(place))
    except (Exception, SystemExit) as error:  # whatever somebody's code does
        why = f"{type(error).__name__}: {reason_of(error)}"
        if isinstance(error, ModuleNotFoundError):
            why = f"no module '{error.name}'"
        raise InputError(f"{option}: '{place}' cannot be imported: {why}") from None
    if name not in known:
        names = [each for each in known if not each.startswith("_")]
        raise InputError(f"{option}: {known_names('name', name, names, listed=False)} in '{place}'")
    return known[name]


ARGUMENTS: Mapping[str, Callable[[TrainConfig], Any]] = {
    **{name: attrgetter(name) for name in ("robot", "actuation", "physics_timestep", "reference_start")},
    "contract": _contract,
    "motion": _motion,
    "task": _task,
    "terrain": _terrain,
    "randomisation": _randomisation,
    "curriculum": _curriculum,
    "privileged": lambda config: Argument(config.privileged, list(config.privileged)),
}
"""Readers from the options, by the environments' keyword; what is not an `Argument` is plain, and told as it is."""
ONLY_TRAINED = ("randomisation", "curriculum", "privileged")
"""Arguments not passed to preview environments or scenarios."""


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """Contract, robot, motion and task of a run of `train`, read and checked."""

    scenario: Scenario
    contract: PolicyContract
    """As it was read, before the robot's own limits went into it."""
    task: str
    """Name in `TASKS`, or of a class of the user's own."""
    arguments: Mapping[str, Any]
    """Arguments of the environments, by keyword."""
    told: Mapping[str, Any]
    """Plain values that the arguments came to, which a run that is resumed must have again."""

    def environments(self, robots: int) -> PolicyVectorEnv:
        """Make so many robots, for either library."""
        return PolicyVectorEnv(robots, **self.arguments, autoreset_mode="SameStep")

    def environment(self) -> PolicyEnv:
        """Make one robot that is as its model says, to be looked at from an episode's beginning."""
        left_out = (*ONLY_TRAINED, "reference_start")
        return PolicyEnv(**{name: value for name, value in self.arguments.items() if name not in left_out})


def subject_of(config: TrainConfig) -> Subject:
    """Read and check what the options name.

    Raises `InputError`: one line with the option, its value and what is accepted.
    """
    require_known("algorithm", (config.algorithm,), ALGORITHMS, "--algorithm: ")
    if config.privileged and config.algorithm == "ppo-sb3":
        raise InputError("--privileged: stable-baselines3's critic sees what the policy sees; give ppo-rsl_rl")
    read = arguments_of(config)
    arguments = {name: argument.value for name, argument in read.items()}
    description = load_robot(config.robot)
    source = arguments["contract"]
    checkpoint = checkpoint_of(source, description.joint_names)
    if arguments["motion"] is None and checkpoint.contract.task_type != "locomotion":
        raise InputError(f"--motion: is missing; {source} carries its motion itself, which a new policy will not")
    try:
        given = {name: value for name, value in arguments.items() if name not in ONLY_TRAINED}
        scenario = make_scenario(**given | {"contract": checkpoint, "robot": description})
        if config.privileged:
            Privileged(config.privileged, is_floating=description.is_floating)
    except InputError as error:
        raise as_options(error) from None
    task = next((name for name, kind in TASKS.items() if type(scenario.task) is kind), type(scenario.task).__name__)
    told = {name: argument.told for name, argument in read.items()}
    return Subject(scenario, checkpoint.contract, task, arguments, told | {"task": told["task"] or task})
