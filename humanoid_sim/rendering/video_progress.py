"""How far the drawing of a video is, for whoever waits for it: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import monotonic

from rich.console import Console
from rich.progress import Progress

from humanoid_sim.rendering.video import VideoReport, VideoSink

_LINE_EVERY = 10.0
"""s between two lines where no terminal shows a bar."""


def finish_video(video: VideoSink, console: Console, hint: str = "") -> VideoReport:
    """Wait until a video is drawn, and show how far it is. An output that cannot be written spoils no video.

    Args:
        video: that has all its frames.
        console: where to show it.
        hint: what Ctrl-C does, for the reader.

    Raises:
        InputError: see `VideoSink.finish`.
    """
    with _shown(video, console, hint) as progress:
        return video.finish(progress)


@contextmanager
def _shown(video: VideoSink, console: Console, hint: str) -> Iterator[Callable[[int, int], None]]:
    note = f" ({hint})" if hint else ""
    if console.is_terminal:
        with Progress(console=console, transient=True) as progress:
            task = progress.add_task(f"drawing the video{note}", total=None)
            yield lambda done, total: progress.update(task, completed=done, total=total)
        return
    with suppress(OSError):
        console.print(f"drawing the rest of {video.frame_count} frames of video{note} ...", markup=False)
    told = monotonic()

    def tell(done: int, total: int) -> None:
        nonlocal told
        if monotonic() - told >= _LINE_EVERY:
            told = monotonic()
            with suppress(OSError):
                console.print(f"{done} of {total} frames drawn", markup=False)

    yield tell
