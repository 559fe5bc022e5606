"""Completion of command lines by the Tab key, in bash: a script that is made from what each program takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from humanoid_sim.command_line import description_of
from humanoid_sim.command_line.description import Command

__all__ = ["bash_completion"]

_SCRIPT = """\
# Completion of humanoid-sim in bash; made by: humanoid-sim --completion bash
_humanoid_sim() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} path= i words=
    for ((i = 1; i < COMP_CWORD; i++)); do
        case "$path ${{COMP_WORDS[i]}}" in
            {paths}) path="$path ${{COMP_WORDS[i]}}" ;;
            *) break ;;
        esac
    done
    case "$path $before" in
{choices}
        *)
            case "$path" in
{options}
            esac ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _humanoid_sim humanoid-sim"""


def bash_completion(programs: Mapping[str, Callable[[Sequence[str] | None], int]]) -> str:
    """A script for bash: verbs, their subcommands and options, and the values of options that have few.

    Args:
        programs: by verb.
    """
    described = {verb: description_of(program) for verb, program in programs.items()}
    commands = [inner for command in described.values() if command is not None for inner in _all(command)]
    known = {" " + " ".join(command.words): command for command in commands}
    paths = [*known, *(f" {verb}" for verb, command in described.items() if command is None)]
    return _SCRIPT.format(
        paths="|".join(f'"{path}"' for path in paths),
        choices="\n".join(
            f'        "{path} {flag}") words="{" ".join((*option.choices, *option.names))}" ;;'
            for path, command in known.items()
            for option in command.options
            for flag in option.flags
            if option.choices or option.names
        ),
        options="\n".join(
            [
                f'                "") words="{" ".join(programs)} --help --version" ;;',
                *(f'                "{path}") words="{_words(command)}" ;;' for path, command in known.items()),
                *(f'                "{path}") words="--help" ;;' for path in paths if path not in known),
            ]
        ),
    )


def _all(command: Command) -> Iterator[Command]:
    yield command
    for inner in command.subcommands:
        yield from _all(inner)


def _words(command: Command) -> str:
    names = [inner.words[-1] for inner in command.subcommands]
    places = [choice for option in command.options if not option.flags for choice in option.choices]
    flags = [flag for option in command.options for flag in option.flags]
    return " ".join([*names, *places, *flags, "--help"])
