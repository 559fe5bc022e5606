"""Completion of command lines by the Tab key: a script for a shell, made from what each program takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from humanoid_sim.command_line import description_of
from humanoid_sim.command_line.description import Command

__all__ = ["SHELLS", "completion"]

_BASH = """\
# Completion of humanoid-sim in bash; made by: humanoid-sim --completion bash
_humanoid_sim() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} place= i words=
    for ((i = 1; i < COMP_CWORD; i++)); do
        case "$place ${{COMP_WORDS[i]}}" in
            {places}) place="$place ${{COMP_WORDS[i]}}" ;;
            *) break ;;
        esac
    done
    case "$place $before" in
{values}
        *)
            case "$place" in
{words}
            esac ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _humanoid_sim humanoid-sim"""

_ZSH = """\
#compdef humanoid-sim
# Completion of humanoid-sim in zsh; made by: humanoid-sim --completion zsh
_humanoid_sim() {{
    local before=${{words[CURRENT-1]}} place= i offered=
    for ((i = 2; i < CURRENT; i++)); do
        case "$place ${{words[i]}}" in
            ({places}) place="$place ${{words[i]}}" ;;
            (*) break ;;
        esac
    done
    case "$place $before" in
{values}
        (*)
            case "$place" in
{words}
            esac ;;
    esac
    compadd -- ${{=offered}} || _files
}}
# Called where the Tab key has loaded this file by its name, registered where the file was sourced.
if [ "$funcstack[1]" = _humanoid_sim ]; then _humanoid_sim "$@"; else compdef _humanoid_sim humanoid-sim; fi"""

_FISH = """\
# Completion of humanoid-sim in fish; made by: humanoid-sim --completion fish
function __humanoid_sim
    set -l typed (commandline -opc)
    set -l place ''
    for word in $typed[2..]
        switch "$place $word"
            case {places}
                set place "$place $word"
            case '*'
                break
        end
    end
    switch "$place $typed[-1]"
{values}
        case '*'
            switch "$place"
{words}
            end
    end
end
complete -c humanoid-sim -a '(__humanoid_sim)'"""


@dataclass(frozen=True, slots=True)
class _Shell:
    """How a shell's script is put together."""

    script: str
    between: str
    """Two alternatives of a case."""
    value: str
    """What is offered after an option, of `place`, `flag` and `offered`."""
    words: str
    """What is offered elsewhere, of `place` and `offered`."""


_SHELLS = {
    "bash": _Shell(
        _BASH,
        "|",
        '        "{place} {flag}") words="{offered}" ;;',
        '                "{place}") words="{offered}" ;;',
    ),
    "zsh": _Shell(
        _ZSH,
        "|",
        '        ("{place} {flag}") offered="{offered}" ;;',
        '                ("{place}") offered="{offered}" ;;',
    ),
    "fish": _Shell(
        _FISH,
        " ",
        "        case '{place} {flag}'\n            string split -- ' ' '{offered}'",
        "                case '{place}'\n                    string split -- ' ' '{offered}'",
    ),
}
SHELLS = tuple(_SHELLS)
"""That a script can be made for."""


def completion(shell: str, programs: Mapping[str, Callable[[Sequence[str] | None], int]]) -> str:
    """A script for a shell: verbs, their subcommands and options, and the values of options that have few.

    Args:
        shell: one of `SHELLS`.
        programs: by verb.
    """
    form = _SHELLS[shell]
    described = {verb: description_of(program) for verb, program in programs.items()}
    commands = [inner for command in described.values() if command is not None for inner in _all(command)]
    known = {" " + " ".join(command.words): command for command in commands}
    places = [*known, *(f" {verb}" for verb, command in described.items() if command is None)]
    offered = {"": f"{' '.join(programs)} --help --version --completion"}
    offered |= {place: _words(known[place]) if place in known else "--help" for place in places}
    quote = "'" if shell == "fish" else '"'
    return form.script.format(
        places=form.between.join(f"{quote}{place}{quote}" for place in places),
        values="\n".join(
            [
                form.value.format(place="", flag="--completion", offered=" ".join(SHELLS)),
                *(
                    form.value.format(place=place, flag=flag, offered=" ".join((*option.choices, *option.names)))
                    for place, command in known.items()
                    for option in command.options
                    for flag in option.flags
                    if option.choices or option.names
                ),
            ]
        ),
        words="\n".join(form.words.format(place=place, offered=words) for place, words in offered.items()),
    )


def _all(command: Command) -> Iterator[Command]:
    yield command
    for inner in command.subcommands:
        yield from _all(inner)


def _words(command: Command) -> str:
    names = [inner.words[-1] for inner in command.subcommands]
    places = [name for option in command.options if not option.flags for name in (*option.choices, *option.names)]
    flags = [flag for option in command.options for flag in option.flags]
    return " ".join([*names, *places, *flags, "--help"])
