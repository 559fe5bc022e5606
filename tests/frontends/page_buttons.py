"""An operator's hands and eyes at a page."""

from typing import Any


def in_mode(page: Any, mode: str, timeout: float = 60.0) -> None:
    page.wait_for_selector(f'#mode[data-mode="{mode}"]', timeout=1e3 * timeout)


def press(page: Any, word: str, mode: str) -> None:
    """Press a button as soon as it is offered, and anew if it was too late: software that draws 3D delays clicks."""
    from playwright.sync_api import TimeoutError as TookTooLong  # noqa: PLC0415 - an optional package

    for _ in range(10):
        page.click(f'#intents [data-ask="{word}"]:not(.refused)', timeout=60_000)
        try:
            return in_mode(page, mode, 5.0)
        except TookTooLong:
            continue
    raise AssertionError(f"{word}: {page.inner_text('#answer')}")
