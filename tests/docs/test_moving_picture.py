"""README's moving picture, as it is stored, and how parts of videos get into it."""

from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image
from script_files import load_script

from humanoid_sim.errors import InputError

ROOT = Path(__file__).parent.parent.parent
PICTURE = ROOT / "docs" / "play.webp"


def test_readme_shows_it():
    assert "](docs/play.webp)" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_moves_and_is_small():
    assert 50_000 < PICTURE.stat().st_size < 2_500_000
    with Image.open(PICTURE) as picture:
        assert picture.format == "WEBP"
        assert picture.size == (640, 360)
        assert picture.info["loop"] == 0
        assert picture.n_frames > 100


@pytest.fixture(scope="module")
def program():
    return load_script(ROOT / "docs" / "moving_picture.py")


def write_video(path):
    """Two seconds at 20 frames a second, which grow lighter."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=20)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        for i in range(40):
            picture = np.full((32, 32, 3), 40 + 5 * i, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def test_a_part_of_a_video_at_another_rate_and_size(program, tmp_path):
    write_video(tmp_path / "v.mp4")
    frames = program.video_frames(tmp_path / "v.mp4", 0.5, 1.5, size=(16, 8), rate=10.0)
    assert len(frames) == 10
    assert {frame.size for frame in frames} == {(16, 8)}
    lightness = [np.asarray(frame).mean() for frame in frames]
    assert lightness == sorted(lightness)
    assert lightness[0] == pytest.approx(90.0, abs=4.0)
    assert lightness[-1] == pytest.approx(180.0, abs=4.0)


def test_a_part_after_the_end_is_refused(program, tmp_path):
    write_video(tmp_path / "v.mp4")
    with pytest.raises(InputError, match=r"v\.mp4': shows nothing from 3 to 4 s"):
        program.video_frames(tmp_path / "v.mp4", 3.0, 4.0, size=(16, 8), rate=10.0)
