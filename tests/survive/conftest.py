import pytest
from session_surface import quick_robot


@pytest.fixture
def quick(tmp_path, runtime, monkeypatch):
    """The file of a robot that is in its standby pose within 0.2 s; the working folder is empty, without a display."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return quick_robot(tmp_path)
