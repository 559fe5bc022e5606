import av
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo import run as module
from humanoid_sim.training.ppo.environment import subject_of
from humanoid_sim.training.ppo.options import TrainConfig
from humanoid_sim.training.ppo.run import Videos

LEGS = subject_of(TrainConfig(robot="lite_biped"))


class Still:
    """Answers zeros, and keeps what it saw."""

    def __init__(self):
        self.seen = []

    def answer(self, observations):
        assert observations.shape == (1, 53)
        self.seen.append(observations[0])
        return np.zeros((1, 14), dtype=np.float32)


@pytest.mark.slow  # draws
def test_a_video_shows_an_episode_at_half_speed_ahead(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_VIDEO_SECONDS", 0.4)
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    still = Still()
    videos = Videos(LEGS, tmp_path, 1.0)
    for seconds, steps in ((59.0, 1000), (61.0, 2000), (100.0, 3000)):
        now[0] = seconds
        videos.show(still.answer, steps)
    videos.close()
    videos.close()
    assert [path.name for path in (tmp_path / "videos").iterdir()] == ["0000002000.mp4"]
    assert len(still.seen) == 20
    np.testing.assert_allclose(still.seen[-1][6:9], [0.4, 0.0, 0.0])  # the contract's greatest is 0.8 m/s
    with av.open(str(tmp_path / "videos" / "0000002000.mp4")) as opened:
        stream = opened.streams.video[0]
        assert (stream.width, stream.height, stream.frames) == (640, 360, 10)


def test_none_is_made_unless_asked_for(tmp_path):
    answer = None  # which would fail
    for minutes in (None, 60.0):
        videos = Videos(LEGS, tmp_path, minutes)
        videos.show(answer, 1000)
        videos.close()
        assert (tmp_path / "videos").exists() is (minutes is not None)


@pytest.mark.slow
def test_a_network_that_fails_leaves_no_video(tmp_path):
    def answer(observations):
        raise RuntimeError("broken")

    videos = Videos(LEGS, tmp_path, 1e-9)
    with pytest.raises(RuntimeError, match="broken"):
        videos.show(answer, 1000)
    assert list((tmp_path / "videos").iterdir()) == []


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "videos").write_text("")
    with pytest.raises(InputError, match=r"videos: cannot be made a folder: File exists"):
        Videos(LEGS, tmp_path, 1.0)
