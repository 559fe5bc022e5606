"""The package's exceptions.

`HumanoidSimError` is the root. `InputError` is for what a user gave (a file, an option, a field): programs print its
one line and exit with status 2. Everything else that escapes a program is a bug.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager


class HumanoidSimError(Exception):
    """Root of every exception that this package raises deliberately."""


class FieldError(HumanoidSimError, ValueError):
    """A value given to one of the package's types is wrong; the message starts with `Type.field`."""


class InputError(HumanoidSimError):
    """A user's input is wrong: one line with the file or option, the field, the value and what is accepted."""

    def __init__(self, message: str) -> None:
        """Keep it one line, whatever names a file holds."""
        super().__init__(message.replace("\n", "\\n").replace("\r", "\\r"))


class RobotError(HumanoidSimError):
    """A robot cannot be activated; the message lists everything that is wrong with it."""


class MissingPackageError(InputError):
    """An optional package is not installed; the message holds the install command."""

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        install = f"pip install 'humanoid_sim[{extra}]'"
        super().__init__(f"{purpose} needs the package '{package}', which is not installed: {install}")


@contextmanager
def needing(package: str, extra: str, purpose: str) -> Iterator[None]:
    """Raise `MissingPackageError` if an import within fails."""
    try:
        yield
    except ImportError:
        raise MissingPackageError(package, extra, purpose) from None


@contextmanager
def blaming(
    what: object,
    kind: type[Exception] | tuple[type[Exception], ...] = FieldError,
    into: type[Exception] = InputError,
) -> Iterator[None]:
    """Turn an error of this kind within into an `InputError`, or `into`, that begins with what was given or done."""
    try:
        yield
    except kind as error:
        if kind is Exception and isinstance(error, InputError):
            raise  # it names the file and the reason itself
        reason = error if isinstance(error, HumanoidSimError) else getattr(error, "strerror", None) or reason_of(error)
        raise into(f"{what}: {reason}") from None


def known_names(what: str, name: str, known: Iterable[str]) -> str:
    """Return `unknown joint 'elbw' (did you mean 'elbow'?); known: elbow, wrist`."""
    names = list(known)
    return f"unknown {what} '{name}'{meant(name, names)}; known: {', '.join(names) or 'none'}"


def require_known(what: str, names: Iterable[str], known: Collection[str], where: str = "") -> None:
    """Raise an `InputError`, which `where` begins, for the first name that does not exist."""
    for name in names:
        if name not in known:
            raise InputError(f"{where}{known_names(what, str(name), known)}")


def meant(name: str, known: Iterable[str]) -> str:
    """Return ` (did you mean 'elbow'?)`, of the known name that is near; empty if none is."""
    import difflib  # noqa: PLC0415 - only where something is wrong

    names = {other.lower(): other for other in known}
    # At 0.7 a shoulder would be an ankle; left_knee and right_knee, rs-02 and rs-04 are close in letters alone.
    near = difflib.get_close_matches(name.lower(), names, n=1, cutoff=0.75)
    near = [other for other in near if _apart(other) == _apart(name.lower())] or [
        other for other in names if _is_tail(name.lower(), other) or _is_tail(other, name.lower())
    ]
    return f" (did you mean '{names[near[0]]}'?)" if len(near) == 1 else ""


def _is_tail(name: str, tail: str) -> bool:
    """Return True for `left_hip` of `g1_left_hip` and `g1/left_hip`."""
    return bool(tail) and name.endswith((f"_{tail}", f"/{tail}"))


def _apart(name: str) -> list[str]:
    """Return sides and numbers: what distinguishes things of one kind."""
    return re.findall(r"left|right|[0-9]+", name)


def number_in(text: str) -> float:
    """Return the number that a user's text is; NaN if it is none, and for infinity."""
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan


def reason_of(error: BaseException) -> str:
    """Return what another package's exception says, as part of a line; behind its type where that is one word."""
    text = " ".join(str(error).split())
    return text if " " in text else f"{type(error).__name__} {text}".strip()
