"""Exit statuses of the bench tools, beside 0 for success and 2 for what a user can mend."""

from __future__ import annotations

__all__ = ["NOTHING_ANSWERS", "NOT_AS_EXPECTED"]

NOT_AS_EXPECTED = 1
"""The tool worked, and what it found is wrong."""
NOTHING_ANSWERS = 3
"""A motor, or all of them, stayed silent."""
