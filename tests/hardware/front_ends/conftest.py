"""The fixtures of front ends' tests."""

from fates import folder, rows

__all__ = ["folder", "rows"]
