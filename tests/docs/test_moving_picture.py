"""README's moving picture, as it is stored."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parent.parent.parent
PICTURE = ROOT / "docs" / "play.webp"


def test_readme_shows_it() -> None:
    assert "](docs/play.webp)" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_moves_and_is_small() -> None:
    assert 50_000 < PICTURE.stat().st_size < 2_500_000
    with Image.open(PICTURE) as picture:
        assert picture.format == "WEBP"
        assert picture.size == (640, 360)
        assert picture.info["loop"] == 0
        assert picture.n_frames > 100
