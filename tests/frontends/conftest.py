import os

from fates import folder, rows

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

__all__ = ["folder", "rows"]
