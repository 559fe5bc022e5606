"""The page of a run: its recorded poses, its caption, and that it needs neither OpenGL nor a network."""

import base64
import json
import re
import socket

import msgspec
import numpy as np
import pytest
import zstandard

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Event, EventKind, Mode
from humanoid_sim.rendering.moments import Moments
from humanoid_sim.rendering.replay_page import write_page


def scene_of(path):
    """The recorded scene of a page: s, and its messages with their s and arrays."""
    packed = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]+)"', path.read_text("utf-8")).group(1))
    content = zstandard.ZstdDecompressor().decompress(packed[8:])
    end = 8 + int.from_bytes(content[:8], "little")
    scene = msgspec.msgpack.decode(content[8:end])
    return scene["durationSeconds"], [(time, message) for time, message in scene["messages"]]


def spans_of(path):
    return json.loads(re.search(r"const \{ title, spans \} = (.*);", path.read_text("utf-8")).group(1))["spans"]


@pytest.fixture
def moments(make_tick):
    """A second of a pendulum that falls in LOCOMOTION."""
    moments = Moments()
    for index in range(201):
        mode = Mode.STANDBY if index < 80 else Mode.LOCOMOTION
        moments.tick(make_tick(index, 5.0 + index / 200, [0.1 + index / 100], mode))
    moments.event(Event(5.8, "fell", EventKind.FALL))
    return moments


def test_a_page_holds_the_poses_at_their_times_and_opens_no_socket(tmp_path, pendulum, moments, monkeypatch):
    def refuse(*_):
        raise AssertionError("the page needs no network")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    monkeypatch.setenv("MUJOCO_GL", "off")
    page = tmp_path / "run.html"
    write_page(page, pendulum, moments, title="a <b>")
    seconds, messages = scene_of(page)
    assert seconds == pytest.approx(26 / 25)
    poses = [time for time, message in messages if "batched_wxyzs" in message.get("updates", {})]
    assert sorted(set(poses)) == pytest.approx(np.arange(26) / 25)
    assert "<title>a &lt;b&gt;</title>" in page.read_text("utf-8")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.html"]


def test_its_caption_says_the_mode_its_begin_and_the_fall(tmp_path, pendulum, moments):
    write_page(tmp_path / "run.html", pendulum, moments, title="")
    spans = [(time, mode, fallen, begin) for time, mode, fallen, _, begin in spans_of(tmp_path / "run.html")]
    assert spans == [
        (0.0, "STANDBY", False, 0.0),
        (pytest.approx(0.4), "LOCOMOTION", False, pytest.approx(0.4)),
        (pytest.approx(0.8), "LOCOMOTION", True, pytest.approx(0.4)),
    ]


def test_nothing_to_show_is_an_error_and_no_file(tmp_path, pendulum):
    with pytest.raises(InputError, match=r"page '.*run\.html': nothing to show: no tick came from a simulated robot"):
        write_page(tmp_path / "run.html", pendulum, Moments(), title="")
    assert list(tmp_path.iterdir()) == []
