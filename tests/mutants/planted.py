"""Readers that do what none may do: the campaign has to find it."""

import os
from pathlib import Path
from typing import NoReturn

from targets import Target

from humanoid_sim.errors import InputError

__all__ = ["TARGETS"]


def _divide(_: Path) -> None:
    raise ZeroDivisionError


def _hang(_: Path) -> None:
    while True:
        pass


def _print(_: Path) -> None:
    os.write(2, b"a banner")


def _die(_: Path) -> None:
    os.abort()


def _leave(path: Path) -> None:
    (path.parent / "MUJOCO_LOG.TXT").write_text("WARNING")


def _fill(_: Path) -> None:
    bytes(4 << 30)


def _refuse(_: Path) -> NoReturn:
    raise InputError("")


TARGETS = {
    name: Target("file.yaml", "yaml", lambda _: b'{"a": 1}', read)
    for name, read in {
        "traceback": _divide,
        "hang": _hang,
        "print": _print,
        "death": _die,
        "file": _leave,
        "memory": _fill,
        "no line": _refuse,
    }.items()
}
