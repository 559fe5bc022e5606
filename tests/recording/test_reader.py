import pytest
from mcap.writer import Writer

from humanoid_sim.errors import InputError
from humanoid_sim.recording.reader import open_recording


def test_what_is_no_recording_is_refused(tmp_path):
    empty, text, directory, foreign = (tmp_path / name for name in ("empty", "text", "directory", "foreign"))
    empty.touch()
    text.write_text("time, position\n")
    directory.mkdir()
    with foreign.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        writer.finish()
    reasons = {
        empty: "cut at byte 0",
        text: "not a valid MCAP file",
        directory: "is a directory, expected a recording (.mcap)",
        foreign: "no recording: it has no metadata record 'humanoid_sim.session'",
        tmp_path / "gone": "no such file, expected a recording (.mcap)",
    }
    for path, reason in reasons.items():
        with pytest.raises(InputError) as caught:
            open_recording(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert reason in str(caught.value)
