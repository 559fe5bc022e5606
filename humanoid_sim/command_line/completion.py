"""Completion of command lines by the Tab key: a script for a shell, which `shtab` makes of what each program takes."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence

import shtab

from humanoid_sim.assets import shipped
from humanoid_sim.command_line import description_of
from humanoid_sim.command_line.description import Program

SHELLS = ("bash", "zsh")
"""That a script can be made for."""


def completion(shell: str, programs: Mapping[str, Callable[[Sequence[str] | None], int]]) -> str:
    """Write a script for one of `SHELLS`: verbs, their subcommands and options, and the values of options."""
    root = argparse.ArgumentParser("humanoid-sim")
    root.add_argument("--version", action="store_true")
    root.add_argument("--completion", choices=SHELLS)
    verbs = root.add_subparsers(parser_class=argparse.ArgumentParser)
    functions: dict[str, str] = {}
    for verb, program in programs.items():
        described = description_of(program)
        verbs.add_parser(verb, help="", parents=[] if described is None else [described])
        for command in [] if described is None else _all(described):
            for field, option in command.options.items():
                if not option.choices and option.nargs != 0:
                    functions |= _offer(option, command.kinds[field], shell)
    return str(shtab.complete(root, shell, preamble="\n".join(functions.values())))


def _offer(option: argparse.Action, kinds: list[str], shell: str) -> dict[str, str]:
    """Have an option complete what ships and files; gives the functions that it takes, by name."""
    name, words = "_humanoid_sim_" + "_".join(kinds), " ".join(name for kind in kinds for name in shipped(kind))
    offered = {"bash": f"compgen -W '{words}' -f -- \"$1\"", "zsh": f"compadd -- {words}; _files"}[shell]
    setattr(option, "complete", {shell: name} if kinds else shtab.FILE)  # noqa: B010 - it is not an attribute of argparse's
    return {name: f"{name}() {{ {offered}; }}"} if kinds else {}


def _all(program: Program) -> Iterator[Program]:
    yield program
    for inner in program.commands.values():
        yield from _all(inner)
