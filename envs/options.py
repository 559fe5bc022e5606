"""Options of environments that nobody knows."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Any

from humanoid_sim.envs.tasks import TASK_OPTIONS
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.names import near_miss


def check_options(given: Iterable[str], *takers: Callable[..., Any]) -> None:
    """Refuse an option that neither an environment nor its task has.

    Args:
        given: names of options that a signature does not list.
        takers: whose signatures list the other options.

    Raises:
        InputError: it names the nearest option, or all where none is near.
    """
    own = [
        name
        for taker in takers
        for name, parameter in inspect.signature(taker).parameters.items()
        if parameter.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    known = tuple(dict.fromkeys([*own, *TASK_OPTIONS]))
    for name in given:
        if name not in known:
            raise InputError(known_names("option", name, known, listed=not near_miss(name, known)))
