import io
from pathlib import Path

from rich.console import Console

from humanoid_sim.rendering import video
from humanoid_sim.rendering.video import VideoReport, VideoSink, finish_video


class _Drawn(VideoSink):
    """A video whose five frames are drawn one by one."""

    def __init__(self):
        self.frame_count = 5

    def finish(self, progress=None):
        assert progress is not None
        for done in range(1, 6):
            progress(done, 5)
        return VideoReport(Path("run.mp4"), 5, 0.2, "nothing")


def _told(*, terminal):
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=terminal, width=100, highlight=False)
    assert finish_video(_Drawn(), console, "Ctrl-C skips it").frame_count == 5
    return screen.getvalue()


def test_without_a_terminal_a_count_goes_on(monkeypatch):
    clock = iter([0.0, 4.0, 8.0, 12.0, 12.0, 16.0, 20.0])
    monkeypatch.setattr(video, "monotonic", lambda: next(clock))
    assert _told(terminal=False).splitlines() == [
        "drawing the rest of 5 frames of video (Ctrl-C skips it) ...",
        "3 of 5 frames drawn",
    ]


def test_a_terminal_shows_a_bar():
    assert "drawing the video (Ctrl-C skips it)" in _told(terminal=True)


def test_an_output_that_is_full_spoils_no_video():
    class Full(io.StringIO):
        def write(self, text):
            raise OSError(28, "No space left on device")

    assert finish_video(_Drawn(), Console(file=Full())).frame_count == 5
