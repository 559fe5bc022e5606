"""What a broken safety property raises."""

from __future__ import annotations

__all__ = ["SafetyViolationError", "require"]


class SafetyViolationError(AssertionError):
    """A control stack or a controller broke a safety property; the message says which, and how."""


def require(holds: bool, message: str, *values: object) -> None:
    """Raise a `SafetyViolationError` unless the property holds; unlike `assert`, under `python -O` too.

    Args:
        holds: the property.
        message: with a `{}` for each of `values`: arrays are written out only when there is something to say.
        values: what the message shows.
    """
    if not holds:
        raise SafetyViolationError(message.format(*values))
