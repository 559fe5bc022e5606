"""Command lines that are refused, and what is said of each: the blocks of a file `refusals.txt` beside a test."""

from pathlib import Path


def refusals(test: str) -> list[list[str]]:
    """Pairs of command line and message; `test` is the test's own file. A message that ends in … is a beginning."""
    text = Path(test).with_name("refusals.txt").read_text(encoding="utf-8").replace("{long}", "x" * 300)
    return [block.removeprefix("$ ").rstrip("\n").split("\n") for block in text.split("\n\n")]


def is_said(message: str, error: str) -> bool:
    """Tell whether stderr has this message, in one line and nothing else."""
    expected = f"error: {message}"
    is_same = error.startswith(expected[:-1]) if message.endswith("…") else error == f"{expected}\n"
    return is_same and error.endswith("\n") and error.count("\n") == 1
