"""Which front ends the options of `play` ask for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from humanoid_sim.errors import InputError
from humanoid_sim.frontends import FRONT_ENDS, Wanted, require_packages
from humanoid_sim.play.options import PlayConfig

__all__ = ["refuse_old_names", "wanted_front_ends"]

_OLD_NAMES = {("--viewer", "web"): "--console", ("--remote", "dds"): "--dds"}


def refuse_old_names(arguments: Sequence[str]) -> None:
    """Refuse options of earlier versions.

    Raises:
        InputError: naming the option that has taken its place.
    """
    words = [word for argument in arguments for word in argument.split("=", 1)]
    for pair in pairwise(words):
        if pair in _OLD_NAMES:
            raise InputError(f"{pair[0]}: {pair[1]} is now {_OLD_NAMES[pair]}")


def wanted_front_ends(config: PlayConfig) -> tuple[Wanted, ...]:
    """The front ends that a run starts.

    Raises:
        InputError: one is not in this version, or its packages are not installed.
    """
    wanted = []
    if config.remote == "gravity":
        wanted.append(Wanted("gravity", ("--form", config.gravity_form)))
    for name, is_wanted in (
        ("console", config.console),
        ("gamepad", config.gamepad),
        ("dds", config.dds),
        ("foxglove", config.foxglove),
    ):
        if is_wanted:
            wanted.append(Wanted(name))
    for front_end in wanted:
        if front_end.name not in FRONT_ENDS:
            raise InputError(f"--{front_end.name}: is not in this version; there are: {', '.join(FRONT_ENDS)}")
        require_packages(front_end.name)
    return tuple(wanted)
