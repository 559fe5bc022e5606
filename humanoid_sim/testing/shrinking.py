"""How long Hypothesis may look for a shorter run that leads to the same violation."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from hypothesis.internal.conjecture import engine
from hypothesis.reporting import current_reporter, with_reporter

SHRINK_SECONDS = 30.0
"""s, unless another time is given."""


@contextmanager
def shrinking_for(seconds: float) -> Iterator[None]:
    """Let Hypothesis shrink for so long; it takes no such setting, and says "five minutes" when its time is up."""
    before, report = engine.MAX_SHRINKING_SECONDS, current_reporter()

    def without_that(text: object) -> None:
        if "more than five minutes" not in str(text):
            report(text)

    engine.MAX_SHRINKING_SECONDS = seconds  # type: ignore[assignment]  # it is added to a float
    try:
        with with_reporter(without_that):
            yield
    finally:
        engine.MAX_SHRINKING_SECONDS = before
