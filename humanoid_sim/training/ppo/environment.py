"""Which option of `train` becomes which argument of the environments."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, NamedTuple

from humanoid_sim.envs.curriculum import Curriculum, amounts_at, scheduled
from humanoid_sim.envs.registration import ENVIRONMENTS
from humanoid_sim.envs.tasks import TASKS, Task
from humanoid_sim.errors import InputError, known_names, reason_of
from humanoid_sim.files import is_file
from humanoid_sim.simulation.batch import Randomisation
from humanoid_sim.simulation.terrain import Terrain
from humanoid_sim.strict_yaml import read_yaml
from humanoid_sim.training.ppo.options import TrainConfig

_YAML = (".yaml", ".yml")
_FORM = "FILE.py:NAME or MODULE:NAME"


class Argument(NamedTuple):
    """One argument of an environment."""

    value: Any
    told: Any
    """What the folder's `run.json` keeps of it, so that a run is resumed as it was begun, whatever became of its files:
    plain values."""


def arguments_of(config: TrainConfig) -> dict[str, Argument]:
    """Return the environments' arguments by keyword.

    Raises:
        InputError: one line with the option, its value and what is accepted.
    """
    return {name: read(config) for name, read in ARGUMENTS.items()}


def as_options(error: InputError) -> InputError:
    """Return what an environment says about an argument, said of the option."""
    name, colon, rest = str(error).partition(":")
    return InputError(f"--{name.replace('_', '-')}:{rest}") if colon and name in ARGUMENTS else error


def _as_given(name: str) -> Callable[[TrainConfig], Argument]:
    return lambda config: Argument(getattr(config, name), getattr(config, name))


def _task(config: TrainConfig) -> Argument:
    text = config.task
    if ":" not in text:
        if text not in ("auto", *TASKS):
            raise InputError(f"--task: {known_names('task', text, ('auto', *TASKS))}; or a class of your own, {_FORM}")
        return Argument(text, None)  # told by what it comes to
    task = own_object("--task", text)
    if not (inspect.isclass(task) and issubclass(task, Task)):
        raise InputError(f"--task: '{text}' is no task, expected a subclass of humanoid_sim.envs.tasks.Task")
    if inspect.isabstract(task):
        missing = ", ".join(sorted(task.__abstractmethods__))
        raise InputError(f"--task: '{text}' is no whole task, it lacks {missing}")
    return Argument(task, text)


def _contract(config: TrainConfig) -> Argument:
    """Return that of the environment that is registered for the robot; of others that of the arms."""
    known = {usual["robot"]: usual["contract"] for usual in _usual()}
    source = config.contract or known.get(config.robot) or _usual()[0]["contract"]
    return Argument(source, source)


def _motion(config: TrainConfig) -> Argument:
    names = list(config.motion)
    if not names:
        of_contract = {usual["contract"]: usual.get("motion") for usual in _usual()}
        name = of_contract.get(_contract(config).value)
        return Argument(name, name)
    motion = names[0] if len(names) == 1 else names
    return Argument(motion, motion)


def _usual() -> list[dict[str, Any]]:
    """Return what the registered environments of one policy are about."""
    of_all = (entry.get("kwargs", {}) for entry in ENVIRONMENTS.values())
    return [arguments for arguments in of_all if "contract" in arguments]


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
        raise InputError(f"--curriculum: '{text}' is no function, expected one of the progress, 0 to 1")
    _checked(function, text)
    return Argument(function, text)


def _checked(function: Curriculum, text: str) -> None:
    for progress in (0.0, 0.5, 1.0):
        try:
            amounts_at(function, progress)
        except InputError as error:
            raise InputError(f"{text}: {error}") from None
        except Exception as error:
            raise InputError(
                f"--curriculum: '{text}' fails at the progress {progress:g}: {type(error).__name__}: {error}"
            ) from None


def _fields(option: str, file: str) -> Any:
    values = read_yaml(Path(file))
    if not isinstance(values, dict):
        raise InputError(f"{option}: '{file}' has no fields, expected a mapping")
    return values


def _named(text: str, values: Any, make: Callable[[Any], Any]) -> Any:
    """Made of the values of a file, which a complaint names."""
    try:
        return make(values)
    except InputError as error:
        if values is text:
            raise as_options(error) from None
        raise InputError(f"{text}: {error}") from None


def _privileged(config: TrainConfig) -> Argument:
    return Argument(config.privileged, list(config.privileged))


def own_object(option: str, text: str) -> Any:
    """Return what `text` names: `examples/own_task.py:HoldTask`, or `my_package.tasks:HoldTask`.

    Args:
        option: which says so, for messages.
        text: a file or a module that can be imported, a colon, and a name in it.

    Raises:
        InputError: there is no such file, module or name, or it fails as it is imported.
    """
    place, _, name = text.rpartition(":")
    if not place or not name.isidentifier():
        raise InputError(f"{option}: is '{text}', expected {_FORM}")
    try:
        module = _from_file(option, Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except InputError:
        raise
    except ModuleNotFoundError as error:
        raise InputError(f"{option}: '{place}' cannot be imported: no module '{error.name}'") from None
    except (Exception, SystemExit) as error:  # whatever somebody's code does
        raise InputError(
            f"{option}: '{place}' cannot be imported: {type(error).__name__}: {reason_of(error)}"
        ) from None
    if not hasattr(module, name):
        names = [each for each in vars(module) if not each.startswith("_")]
        raise InputError(f"{option}: {known_names('name', name, names, listed=False)} in '{place}'")
    return getattr(module, name)


def _from_file(option: str, path: Path) -> ModuleType:
    if not is_file(path):
        raise InputError(f"{option}: '{path}': no such file")
    name = f"humanoid_sim_own_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


ARGUMENTS: Mapping[str, Callable[[TrainConfig], Argument]] = MappingProxyType(
    {
        "contract": _contract,
        "robot": _as_given("robot"),
        "motion": _motion,
        "task": _task,
        "actuation": _as_given("actuation"),
        "physics_timestep": _as_given("physics_timestep"),
        "terrain": _terrain,
        "reference_start": _as_given("reference_start"),
        "randomisation": _randomisation,
        "curriculum": _curriculum,
        "privileged": _privileged,
    }
)
"""By the environments' keyword, what reads it from the options."""
ONLY_TRAINED = ("randomisation", "curriculum", "privileged")
"""Arguments that a robot does not get that is only looked at, nor a scenario."""
