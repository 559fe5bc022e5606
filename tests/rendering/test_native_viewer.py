import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering.native_viewer import check_window


@pytest.mark.parametrize(("display", "reason"), [("", "no display"), (":4711", "the display does not answer")])
def test_a_window_that_cannot_be_opened_is_refused_with_what_to_use_instead(monkeypatch, display, reason):
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match=rf"^viewer native: {reason}.*; --html out\.html shows the run"):
        check_window()
